"""Roll out the motion of a team's virtual agents under the paper's forces, in compiled code.

The fire is static. Tuning needs tens of thousands of roll-outs. The flight uses the same kernels.
"""

from firemodel.compiled import kernel
from mission_service.guidance.formation.virtual_forces_kernels import is_set, velocity_of_forces


@kernel
def unroll(  # type: ignore[no-untyped-def]
    agents, before, steps, step_s, ties_rad, centre_x_m, centre_y_m, augmentation, area, danger,
    west_m, north_m, cell_m, constants, spacing_m, max_m_s,
):  # fmt: skip
    """Move ``agents`` (2, n) by ``steps`` steps; in a step all agents move at once (eq. 12).

    Positions are x and y in metres; ``before`` (2, n) is a work array. Every agent receives the
    positions of all others. Returns how many steps, summed over the agents, lead to positions where
    the map ``danger`` is set.
    """
    n = agents.shape[1]
    touched = 0
    for _ in range(steps):
        for i in range(n):
            before[0, i], before[1, i] = agents[0, i], agents[1, i]
        for i in range(n):
            x_m, y_m = before[0, i], before[1, i]
            # An agent does not repel itself: its position is moved out of reach temporarily.
            before[0, i] += 1e9
            east, north = velocity_of_forces(
                x_m, y_m, before[0], before[1], centre_x_m, centre_y_m, augmentation, area,
                west_m, north_m, cell_m, constants, spacing_m, max_m_s, ties_rad[i],
            )  # fmt: skip
            before[0, i] = x_m
            agents[0, i] += east * step_s
            agents[1, i] += north * step_s
            if is_set(danger, agents[0, i], agents[1, i], west_m, north_m, cell_m):
                touched += 1
    return touched
