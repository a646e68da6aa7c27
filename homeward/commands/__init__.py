"""The subcommands of `homeward`, one a file, beside what they plot; `train`, `evaluate` and `diagnose`
are links to the scripts at the top."""
