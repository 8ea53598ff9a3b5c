"""Blind benchmark: truths made by other formulations than the diagnosis knows, sealed before it begins, scored afterwards."""
