"""Reader of EMDB's sequences (Kaufmann et al. 2023)."""
