"""The command line: one file a family of commands, their words, their exit codes."""
