"""What the wrench plan costs: methods are judged under loads they never met."""
