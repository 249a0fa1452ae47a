"""A motion to look at: one page of HTML that plays it in 3D, in any browser and without network."""
