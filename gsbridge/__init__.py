"""gsbridge: a phone video in, a robot policy out, and an honest account of the gap between simulation and reality."""

__version__ = "0.1.0"
