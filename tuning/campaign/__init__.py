"""Monte Carlo campaigns: how sure one may be of a set of gains."""
