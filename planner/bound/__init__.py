"""Lower bounds on the squeezes of any plan: a certificate of how near the best a plan is."""
