"""The sections of pages, one file a section."""
