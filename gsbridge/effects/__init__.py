"""What an effect is, whatever it changes: its parameters, its place on the way from command to log, and its catalogue."""
