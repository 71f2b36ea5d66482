import numpy as np

from mission_service.formation.messages import FireUpdate

NO = np.empty(0, np.int64)


class SharedMap:
    def __init__(self, name, shape):
        self.name = name
        self.fire = np.zeros(shape, bool).ravel()
        self.out = []

    def see(self, on, off, at_us):
        if len(on):
            self.out.append(FireUpdate(at_us, self.name, tuple(int(c) for c in on)))
        return on, off

    def hear(self, m):
        return (np.array(m.burning, np.int64), NO) if isinstance(m, FireUpdate) else (NO, NO)

    def updates(self, at_us):
        self.out = []
        return []

    def messages(self, at_us):
        o, self.out = self.out, []
        return o
