"""Reports and figures of a campaign."""
