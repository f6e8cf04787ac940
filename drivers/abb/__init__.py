"""ABB arms whose controller runs the public open_abb server; README.md says how to set that up."""
