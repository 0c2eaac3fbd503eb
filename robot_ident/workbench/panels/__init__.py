"""What is shown of a step, one panel a file: functions of what is on disk, without callbacks."""
