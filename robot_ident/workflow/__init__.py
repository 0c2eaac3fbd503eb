"""What a user does, as plain functions that commands, workbench and report share: read, diagnose, add, look ahead."""
