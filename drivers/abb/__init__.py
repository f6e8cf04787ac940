"""ABB arms: open_abb on IRC5, a RAPID module of ours on OmniCore; poses, reach, what upright arms share."""
