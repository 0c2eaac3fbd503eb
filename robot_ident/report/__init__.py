"""Self-contained HTML pages: a frame, and sections that are each a function that fills a template."""
