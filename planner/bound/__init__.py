"""Lower bounds on the squeezes of any plan, which certify how near the optimum a plan is."""
