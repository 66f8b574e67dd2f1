"""The book's PID controller (chapter 5.2), with a dead band and saturation of the error."""

import math


class PID:
    """A controller that converts an error into a command.

    An error smaller than *min_error* counts as 0, and an error larger than *max_error* as *max_output*. An
    error in between is scaled to *min_output* … *max_output*. The gains apply to the scaled error. Each call
    multiplies the integral by 2/3. The default gains are those of the book's class.

    Args:
        min_error: The size of an error below which it counts as 0.
        max_error: The size of an error above which it counts as *max_output*.
        min_output: The size of the scaled error at its lower end.
        max_output: The maximum size of the scaled error and of the command.

    """

    def __init__(self, min_error: float, max_error: float, min_output: float, max_output: float) -> None:
        self.min_error = min_error
        self.max_error = max_error
        self.min_output = min_output
        self.max_output = max_output
        self.set_gains(0.41, 0.06, 0.53)
        self.reset()

    def set_gains(self, proportional: float, integral: float, derivative: float) -> None:
        """Set the gains."""
        self._kp, self._ki, self._kd = proportional, integral, derivative

    def reset(self) -> None:
        """Forget previous errors."""
        self._integral = 0.0
        self._previous = 0.0

    def output(self, error: float) -> float:
        """Return the command for *error*, taking previous errors into account."""
        size = abs(error)
        if size < self.min_error:
            scaled = 0.0
        elif size > self.max_error:
            scaled = math.copysign(self.max_output, error)
        else:
            scaled = math.copysign(self.min_output, error) + error * (self.max_output - self.min_output)
        # The integral decays, so that old errors lose their effect.
        self._integral = (self._integral + scaled) * 2.0 / 3.0
        derivative = scaled - self._previous
        self._previous = scaled
        command = self._kp * scaled + self._ki * self._integral + self._kd * derivative
        return min(max(command, -self.max_output), self.max_output)
