"""The journal of runs: its chained records and files, their replay, statistics and export."""
