"""Networks that learn how an arm deflects, first from springs, then from readings."""
