"""One robot's navigator: pose, planning, following, the way back."""
