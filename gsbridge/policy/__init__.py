"""Policies (SACwB and others) that learn from pictures and a baseline controller: training, evaluation, export, deployment."""
