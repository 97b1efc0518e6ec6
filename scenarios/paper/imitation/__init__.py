"""A network learns what fitted springs say: Tables 6 and 7, Fig. 5."""
