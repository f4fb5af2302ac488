"""The control as a block diagram."""

from docs.pictures.canvas import Canvas

ROW, BOTTOM = 110, 318
"""Height of the forward path and of the feedback, in pixels."""


def _block(canvas: Canvas, x: float, y: float, width: float, lines: tuple[str, ...], edge: str = "grey") -> None:
    height = 74
    canvas.rectangle(x, y - height / 2, width, height, edge=edge)
    top = y + 5 - 9 * (len(lines) - 1)
    for number, line in enumerate(lines):
        style = "" if number == 0 else "small"
        canvas.words(x + width / 2, top + 19 * number, line, "ink" if number == 0 else "grey", style)


def blocks() -> Canvas:
    """Reference, law, coordination, winches, plant, sensors, estimator."""
    canvas = Canvas(
        1060, 400, "The controller",
        "The reference and the estimate enter the position law, whose force command is clipped to its limits. The "
        "coordination makes two tension commands of it; two winch controllers make torques of these. Sensors and an "
        "estimator close the loop.",
    )  # fmt: skip
    canvas.words(48, ROW - 14, "x_d , v_d , a_d", "blue", "small symbol")
    canvas.line([(12, ROW), (96, ROW)], "blue", head=True)
    _block(canvas, 96, ROW, 186, ("position law", "sliding mode + observer"), "blue")
    canvas.line([(282, ROW), (340, ROW)], head=True)
    canvas.words(310, ROW - 12, "u", "ink", "symbol")
    _block(canvas, 340, ROW, 88, ("limit", "± U"))
    canvas.line([(428, ROW), (486, ROW)], head=True)
    canvas.words(458, ROW - 12, "u_sat", "ink", "symbol")
    _block(canvas, 486, ROW, 130, ("coordination", "(P ± u)/2"), "green")
    for offset, number in ((-24, 1), (24, 2)):
        colour = f"rope{number}"
        canvas.line([(616, ROW + offset), (688, ROW + offset)], colour, head=True)
        canvas.words(650, ROW + offset - 8, f"F_{number},cmd", colour, "small symbol")
        canvas.rectangle(688, ROW + offset - 20, 112, 40, edge=colour)
        canvas.words(744, ROW + offset + 5, f"winch {number}: PID", "ink", "small")
        canvas.line([(800, ROW + offset), (880, ROW + offset)], colour, head=True)
        canvas.words(838, ROW + offset - 8, f"τ_{number}", colour, "small symbol")
    canvas.rectangle(880, ROW - 48, 160, 96, fill="paper", edge="ink")
    canvas.words(960, ROW - 6, "plant")
    canvas.words(960, ROW + 16, "vehicle, ropes, drums", "grey", "small")
    canvas.line([(960, ROW - 94), (960, ROW - 48)], "red", head=True)
    canvas.words(948, ROW - 72, "vortices, current, load", "red", "small", "end")
    canvas.line([(960, ROW + 48), (960, BOTTOM - 37)], head=True)
    canvas.words(970, (ROW + BOTTOM) / 2 + 8, "x, v, F, ω", "ink", "small symbol", "start")
    _block(canvas, 890, BOTTOM, 140, ("sensors", "noise, offset, steps"))
    canvas.line([(890, BOTTOM), (760, BOTTOM)], head=True)
    _block(canvas, 570, BOTTOM, 190, ("estimator", "none, low-pass, Kalman …"), "green")
    canvas.line([(570, BOTTOM), (189, BOTTOM), (189, ROW + 37)], head=True)
    canvas.words(380, BOTTOM - 12, "estimated x, v", "ink", "small")
    canvas.line([(720, BOTTOM - 37), (720, ROW + 44)], head=True)
    canvas.words(710, (ROW + BOTTOM) / 2 + 14, "tensions", "ink", "small", "end")
    canvas.words(530, 384, "every block is one file, sampled at 1 ms; its numbers are its own", "grey", "small")
    return canvas
