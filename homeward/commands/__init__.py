"""The subcommands of `homeward`, one a file; `train`, `evaluate` and `diagnose` are links to the
scripts at the top."""
