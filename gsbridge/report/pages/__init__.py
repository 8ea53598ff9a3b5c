"""Pages of tables, scenes and masks, and the look of all pages. Builds on tables and figures."""
