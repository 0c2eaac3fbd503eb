"""The command line: a parser and a call for each verb; it alone prints."""
