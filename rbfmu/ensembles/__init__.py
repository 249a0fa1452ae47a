"""Many runs of one scene in which some of its numbers vary."""
