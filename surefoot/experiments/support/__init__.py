"""What experiments share: targets, trials, walks."""
