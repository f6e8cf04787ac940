"""ABB arms: IRC5 by open_abb, OmniCore by a RAPID module; poses, reach and a base class of upright arms."""
