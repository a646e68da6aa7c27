"""Layout of pages and of text: numbers, templates and plots."""
