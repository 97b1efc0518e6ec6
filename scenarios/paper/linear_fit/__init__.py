"""Six linear springs are fitted as the paper does: Tables 2 and 3, Fig. 4."""
