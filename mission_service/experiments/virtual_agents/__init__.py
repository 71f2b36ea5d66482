"""The "Virtual agents" paper, section 6: fixed wings in formation around a fire."""
