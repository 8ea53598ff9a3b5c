"""Pages, figures and rows of the gap between simulation and reality. Builds on pages and scores."""
