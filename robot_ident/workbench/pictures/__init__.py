"""The pictures of the workbench, one a file; they share their colours."""
