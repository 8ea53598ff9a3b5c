"""The page of tables and the look of all pages. Builds on tables and figures."""
