"""Studies of many runs: blind trials, the 2024 paper, benchmarks, recorded arms."""
