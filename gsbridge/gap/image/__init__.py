"""What pictures lack: the diagnosis of photos against splats. Unfinished: it is not calibrated, and no rule uses it."""
