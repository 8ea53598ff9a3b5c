"""Blind benchmark: truths from simulators other than the diagnosis uses, sealed before the diagnosis and scored after it."""
