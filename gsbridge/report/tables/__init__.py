"""Tables: rows as CSV files, statistics of them, and their layout for print. Imports no other part of the report."""
