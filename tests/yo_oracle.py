"""The phases of a yo once more, in plain Python, written from what the settings say.

Numbers only, one dictionary of them for a mission, `if` and `else` in the order in
which a pilot would tell it. `tests/test_yo.py` flies both through the same depths.
"""

import math

SURFACE, DIVE, APOGEE, CLIMB, INFLECTION = range(5)
UNDER_WAY, COMPLETED, UNFINISHED, BOTTOM, HOVER, STALL, EMPTY = range(7)


class Pilot:
    """Flies one mission; `plan` is a dictionary of its settings."""

    def __init__(self, plan, depth):
        self.plan, self.phase, self.status = plan, SURFACE, UNDER_WAY
        self.in_phase = self.in_half = 0.0
        self.yos, self.yos_at_surfacing, self.last_surface = 0, 0, 0.0
        self.believed, self.since_believed, self.rate = depth, 0.0, 0.0
        self.half_depth = self.trigger = self.farthest = self.record = depth
        self.early = {"bottom": 0.0, "top": 0.0}
        self.turned_below = False
        self.hovering = self.stalled = 0.0
        self.ballast = {"dive": plan["dive_kg"], "climb": plan["climb_kg"]}
        self.ordered = plan["surface_kg"]
        self.was = (0.0, 0.0)

    def tick(self, time, dt, depth, altitude, charge, pump, mass):
        """Orders of a tick: phase, status, ballast, a waiting mass, steering limit."""
        self.listen(depth, dt)
        self.count(dt)
        self.judge(altitude, charge)
        self.change_phase(time, dt, altitude, pump, mass)
        self.regulate(dt)
        orders = self.orders()
        self.in_phase += dt
        self.in_half += dt
        self.ordered, self.was = orders[2], (pump, mass)
        return orders

    def listen(self, depth, dt):
        gap = self.since_believed + dt
        if abs(depth - self.believed) > self.plan["depth_rate_limit"] * gap:
            self.since_believed = gap
            return
        share = -math.expm1(-gap / self.plan["rate_memory"])
        self.rate += share * ((depth - self.believed) / gap - self.rate)
        self.believed, self.since_believed = depth, 0.0

    def count(self, dt):
        upward = self.phase in (CLIMB, APOGEE)
        gliding = self.phase in (CLIMB, DIVE)
        z = self.believed
        farther = z < self.record if upward else z > self.record
        if farther:
            self.record = z
        self.stalled = self.stalled + dt if gliding and not farther else 0.0
        hovers = gliding and abs(self.rate) < self.plan["hover_rate"]
        self.hovering = self.hovering + dt if hovers else 0.0
        self.farthest = max(self.farthest, z) if upward else min(self.farthest, z)

    def judge(self, altitude, charge):
        if self.status != UNDER_WAY:
            return
        if altitude <= 0.0:
            self.status = BOTTOM
        elif charge <= 0.0:
            self.status = EMPTY
        elif self.hovering >= self.plan["hover_time"]:
            self.status = HOVER
        elif self.stalled >= self.plan["stall_time"]:
            self.status = STALL

    def last(self, time):
        flown = self.yos if self.phase == SURFACE else self.yos + 1
        return flown >= self.plan["yos"] or time >= self.plan["duration"]

    def wants_up(self, time):
        plan = self.plan
        many = self.yos + 1 - self.yos_at_surfacing >= plan["every_yos"]
        return self.last(time) or many or time - self.last_surface >= plan["every"]

    def change_phase(self, time, dt, altitude, pump, mass):
        plan, z, before = self.plan, self.believed, self.phase
        if before == SURFACE:
            if self.last(time) and self.status == UNDER_WAY:
                self.status = COMPLETED
            stay = plan["first_stay"] if self.yos == 0 else plan["stay"]
            if self.in_phase >= stay:
                self.go(INFLECTION)
            self.last_surface = time
        elif before == INFLECTION and self.first_done("top", dt, pump, mass):
            self.go(DIVE)
        elif before == DIVE:
            early = min(self.early["bottom"], plan["early_most"])
            low = altitude <= min(plan["altitude"] + early, plan["altimeter_range"])
            if z >= plan["bottom"] - early or low:
                self.go(APOGEE)
        elif before == APOGEE and self.first_done("bottom", dt, pump, mass):
            self.go(CLIMB)
        elif before == CLIMB:
            early = min(self.early["top"], plan["early_most"])
            if self.wants_up(time):
                if z <= plan["surface_depth"]:
                    self.go(SURFACE)
                    self.yos_at_surfacing = self.yos
            elif z <= plan["top"] + early:
                self.go(INFLECTION)

    def first_done(self, where, dt, pump, mass):
        order, longest = self.plan[f"{where}_order"], self.plan[f"{where}_longest"]
        if self.in_phase >= longest:
            return True
        if order == "mass":
            still = abs(mass - self.was[1]) <= 1e-4 * dt
            return self.in_phase >= 2.0 * dt and still
        stroke = abs(self.ballast["dive"]) + abs(self.ballast["climb"])
        if self.in_phase >= dt and abs(pump - self.ordered) <= 0.02 * stroke:
            return True
        still = abs(pump - self.was[0]) <= 0.001 * stroke * dt
        return self.in_phase >= 2.0 * dt and still

    def go(self, phase):
        plan, before = self.plan, self.phase
        self.phase, self.in_phase = phase, 0.0
        self.hovering = self.stalled = 0.0
        self.record = self.believed
        if phase in (DIVE, CLIMB):
            return
        mean_rate = abs(self.believed - self.half_depth) / max(self.in_half, 1e-3)
        beyond = abs(self.farthest - self.trigger)
        if before == CLIMB:
            self.early["bottom"] += plan["share"] * (beyond - self.early["bottom"])
            self.yos += 1
            self.adjust("climb", mean_rate)
        if phase == APOGEE:
            if self.turned_below:
                self.early["top"] += plan["share"] * (beyond - self.early["top"])
            self.adjust("dive", mean_rate)
        self.turned_below = before == CLIMB and phase != SURFACE
        self.in_half = 0.0
        self.half_depth = self.trigger = self.farthest = self.believed

    def adjust(self, half, rate):
        wanted = self.plan[f"{half}_rate"]
        sign = 1.0 if half == "dive" else -1.0
        size = abs(self.ballast[half]) + self.plan["gain"] * (wanted - rate)
        if self.plan[f"{half}_looks"] is not None:
            size = abs(self.plan[f"{half}_kg"])
        self.ballast[half] = sign * min(max(size, 0.0), self.plan["largest"])

    def regulate(self, dt):
        for half, phase in (("dive", DIVE), ("climb", CLIMB)):
            every = self.plan[f"{half}_looks"]
            if every is None or self.phase != phase or self.in_phase <= 0.0:
                continue
            looked = math.floor((self.in_phase - dt) / every)
            missing = self.plan[f"{half}_rate"] - abs(self.rate)
            if math.floor(self.in_phase / every) > looked and missing > 0.005:
                sign = 1.0 if half == "dive" else -1.0
                size = abs(self.ballast[half]) + self.plan["gain"] * missing
                self.ballast[half] = sign * min(size, self.plan["largest"])

    def orders(self):
        plan = self.plan
        if self.phase == SURFACE:
            ballast = plan["surface_kg"]
        elif self.phase == DIVE:
            ballast = self.ballast["dive"]
        elif self.phase == CLIMB:
            ballast = self.ballast["climb"]
        else:
            where = "bottom" if self.phase == APOGEE else "top"
            after = self.ballast["climb" if where == "bottom" else "dive"]
            waits = plan[f"{where}_order"] == "mass"
            between = plan[f"{where}_kg"]
            ballast = self.ordered if waits else (after if between is None else between)
        held = (self.phase == APOGEE and plan["bottom_order"] == "pump") or (
            self.phase == INFLECTION and plan["top_order"] == "pump"
        )
        return self.phase, self.status, ballast, held, self.steering_limit()

    def steering_limit(self):
        plan = self.plan
        if plan["dive_wait"] is None:
            return math.inf
        if self.phase in (CLIMB, APOGEE) and self.in_half < plan["climb_wait"]:
            return 0.0
        if self.phase in (DIVE, INFLECTION) and self.in_half < plan["dive_wait"]:
            return 0.0
        names = {
            DIVE: "dive_steering",
            APOGEE: "bottom_steering",
            CLIMB: "climb_steering",
            INFLECTION: "top_steering",
        }
        limit = plan[names[self.phase]] if self.phase in names else None
        return math.inf if limit is None else limit
