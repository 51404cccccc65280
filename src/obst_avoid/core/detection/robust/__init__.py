"""The robust profile: ours, for real robots in any light."""
