"""Gap: where simulation and measured data disagree, which effect is missing, and what adding it changes."""
