"""What figures, tables and pages are drawn with; nothing here knows a task."""
