"""Questions asked many times: blind trials, the paper, benchmarks, real arms."""
