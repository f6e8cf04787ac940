"""ABB arms: open_abb on IRC5, a RAPID module on OmniCore; poses, reach, common parts of upright arms."""
