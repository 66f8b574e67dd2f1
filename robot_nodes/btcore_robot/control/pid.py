"""The book's PID controller (chapter 5.2), with a dead band and saturation of the error."""

import math


class PID:
    """Turns an error into a command.

    An error with a size under *min_error* counts as none, one over *max_error* as full; between them it
    becomes *min_output* … *max_output*, and that is what the three gains work on. The integral forgets a
    third with each call. The output stays within ± *max_output*. The gains are the book's class defaults.
    """

    def __init__(self, min_error: float, max_error: float, min_output: float, max_output: float) -> None:
        self.min_error = min_error
        self.max_error = max_error
        self.min_output = min_output
        self.max_output = max_output
        self.set_gains(0.41, 0.06, 0.53)
        self.reset()

    def set_gains(self, proportional: float, integral: float, derivative: float) -> None:
        """Set the three gains."""
        self._kp, self._ki, self._kd = proportional, integral, derivative

    def reset(self) -> None:
        """Forget what came before."""
        self._integral = 0.0
        self._before = 0.0

    def output(self, error: float) -> float:
        """The command for *error*, given what came before."""
        size = abs(error)
        if size < self.min_error:
            scaled = 0.0
        elif size > self.max_error:
            scaled = math.copysign(self.max_output, error)
        else:
            scaled = math.copysign(self.min_output, error) + error * (self.max_output - self.min_output)
        self._integral = (self._integral + scaled) * 2.0 / 3.0
        derivative = scaled - self._before
        self._before = scaled
        command = self._kp * scaled + self._ki * self._integral + self._kd * derivative
        return min(max(command, -self.max_output), self.max_output)
