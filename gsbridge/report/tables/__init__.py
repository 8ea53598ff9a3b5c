"""Tables: rows as CSV files, what they come to, and how they are laid out for print. Imports nothing else of the report."""
