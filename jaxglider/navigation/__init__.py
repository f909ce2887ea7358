"""Knowledge of a glider of itself: sensors, estimators, reckoning and fixes."""
