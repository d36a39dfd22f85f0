"""Trials and how many of them are run, kept and counted: executors, run directories, statistics, verdicts."""
