"""Every number that decides what is said, with its reason. Evidence is in nats: natural logarithms of odds."""

from __future__ import annotations

import math

LEVEL = 0.05
"""Family-wise rate of false alarms, of windows and of everything that carries an adjusted p-value."""

ENOUGH_SHARED = 10.0
"""Held-out evidence for a law: odds of 22,000 to 1, which some thirty laws at two settings each share at up to four
steps: a false name in a hundred studies."""

ENOUGH_OWN = 25.0
"""Evidence for what is fitted in every trial anew, and for a shape that no law has: a nat for each of some twenty
trials beside the odds of a law, since no noise model is right to better."""

CLOSE = 0.3
"""Share of the largest linear evidence from which an effect is refitted: linearised it is wrong by a factor of two."""

REFITTED = 3
"""Effects refitted at each step and weighing of the noise; the linear order is rarely wrong by more than two places."""

STARTS = 4
"""Settings of a law's shape from which it is refitted: a relaxation time has an optimum in every decade or two."""

MOST_EFFECTS = 4
"""Effects in one account: twenty trials say no more."""

ENOUGH_ONCE = ENOUGH_SHARED - math.log(MOST_EFFECTS)
"""Evidence for what is asked once of a study, not at each of its steps."""

INEXACT = 0.1
"""An effect as the textbook has it is right to about a tenth of its size, in every trial and phase anew: to a factor of
three (`ROUGH`), beforehand."""

ROUGH = 0.3
"""And at times to a third only; what is off by more is another law."""

UNFORESEEN = 1.0 / 3.0
"""Share of what an effect is off by that is not smooth, or of no shape at all that its inexactness has."""

SURE = -math.log(LEVEL)
"""Times what the laws before it are expected to leave over that an effect must explain: what they do leave is
exponential about that, and once in twenty it is more."""

STRETCHED = 4.0
"""Standard deviations from the textbook beyond which an inner parameter makes a law another one."""

KEPT = 0.5
"""Share of its gain that an effect must bring itself; the other part is that laws are granted to be off beside it, or
what it may do besides."""

SMALL_SHARE = 0.1
"""A remainder of less than so much of the mismatch is a law's own inexactness (the report's contract): one that is
right to a third leaves a tenth. Laws that leave more are the nearest to something else, and are not named."""

TOLERANCE_SHARE = 0.01
"""Where whole recordings lie near the tolerance, a hundredth of their largest force is tolerated instead."""

TEMPER = 0.02
"""c of T = 1 + c * evidence: evidence grows without end while every law is a little wrong."""

WORTH_NAMING = 0.05
"""Probability from which an alternative is listed: 90 % sets hold what has more than half of a tenth."""

TWO_ERRORS = 2.0
"""An account whose evidence is no further behind than this many paired errors is an alternative."""

HIDDEN_STRENGTH = 6.0
"""Noise standard deviations that a law of typical size must raise before it is said that it hides in the tissue."""

ABSORBED_SHARE = 0.06
"""Share of a law's signature below which a tissue imitates it."""

SERVO_EXPLAINS = 0.4
"""Share of the repeatable position mismatch that another servo must explain to be named."""

SERVO_KNOWN = 0.3
"""Standard error of ln(natural frequency) above which a drive is no such servo."""

LINE_LEVEL = 1e-6
"""Chance of a spectral line by noise, over all frequencies looked at; lines cost nothing to be sure of."""

FEW_TRIALS = 8
"""Trials below which the report says that they are few."""

FEWEST_HELD_OUT = 3
"""Trials of which one can be held out; fewer show neither slow noise nor what comes in each trial anew."""
