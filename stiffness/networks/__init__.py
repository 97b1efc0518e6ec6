"""Networks that learn an arm's deflections, first from springs, then from readings."""
