"""What an experiment consists of: its scenes, cells, policies, trials and worlds, and where the results of each lie."""
