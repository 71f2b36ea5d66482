"""Random worlds with closed airspace, and a checker of their flights that shares no code with the
service (``benchmarks.airspace_worlds``)."""
