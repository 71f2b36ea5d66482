"""The guidance of formations: fixed-wing UAVs loiter around a fire, each orbiting a virtual agent.

"The paper" in these modules is the paper on fixed wings that loiter around a wildfire
(docs/experiments.md, section "Virtual agents"). Equation, section and table numbers are those of
the paper. A virtual agent is a moving point, and its UAV (the vehicle) flies an orbit around this
point. All modules are pure: they use no clock, network or random source. Positions are in metres in
the landscape's CRS, with x east and y north. Angles are in radians, anticlockwise from grid east.
"""
