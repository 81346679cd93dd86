"""What one vehicle of a compiled fleet is told or asked, by its block and its lane: text for kernel.py."""

COMMANDS = """
@njit(error_model='numpy', cache=True)
def goto(blocks, constants, b, lane, x, y, z):
    q, c, n = blocks[b], constants[b], np.uint64(lane)
    plan, mode = pilot_goto(
        _plan_of(_plan(q, n)), _mode(q, n), x, y, z, _get_spin_up(c)[0], _get_limits(c))
    _put_plan(q, n, _flat(plan))
    _put_mode(q, n, mode)


@njit(error_model='numpy', cache=True)
def brake(blocks, constants, b, lane):
    q, c, n = blocks[b], constants[b], np.uint64(lane)
    plan, mode = pilot_brake(_plan_of(_plan(q, n)), _mode(q, n), _get_limits(c))
    _put_plan(q, n, _flat(plan))
    _put_mode(q, n, mode)


@njit(error_model='numpy', cache=True)
def room(blocks, constants, b, lane, periods):
    q, n = blocks[b], np.uint64(lane)
    return stopping_room(_plan_of(_plan(q, n)), _mode(q, n), _get_limits(constants[b]), periods)
"""
