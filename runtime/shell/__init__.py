"""What all commands share: arguments, errors, exit codes, files, stop requests; standard library only."""
