"""What a person reads: rows, tables, figures, recordings, and scores against the hidden truth."""
