"""Run the experiments of Bent's thesis, chapter 5: teams that share the front of one fire."""
