"""What `scenarios.calibrate` says, proves and draws."""
