"""Policies: SACwB and its peers, which learn from pictures and a baseline controller; training, evaluation, export."""
