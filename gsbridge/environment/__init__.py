"""The environment that policies meet: any world, seen by any renderer, behind gymnasium's interface."""
