"""Who may say and hear what: SROS2 policies from experiments, and keystores with signed permissions."""
