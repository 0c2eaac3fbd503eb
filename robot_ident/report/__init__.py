"""Self-contained HTML pages: a frame, and sections that are each a small class with its template."""
