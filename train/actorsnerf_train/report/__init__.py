"""Speed against error: the named operating points, and what each costs and spoils, measured."""
