"""What an effect that was added makes needless."""

from __future__ import annotations

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.levels import INEXACT
from analysis.mismatch.name.options import begun_again, better, own_options
from analysis.mismatch.name.rivals import Rival
from analysis.mismatch.name.weighing import enough_for, is_nothing, stands_for_shape


def pruned(account: Account, newest: Rival, nothing: Account) -> tuple[Account, dict[str, float]]:
    """Take out, one by one, what the newest effect and the others make needless; return what the others add, in nats.

    What comes in each trial anew is looked for once more, and laws are begun again: times and forms were found where
    the newest was still missing, and a law that stood for a part of it may not find back from there. ``nothing`` is the
    account without effects.
    The newest comes last: it may have done no more than lead the others to where they predict as well without it.
    What was added is not known where something was taken out since. An account without what explains much is not begun
    anew: that changes hardly a tenth of it.
    """
    adds = {newest.name: newest.gain}
    for name in (*(n for n in account.names if n != newest.name), newest.name):
        if len(account.names) < 2:
            break
        without, anew = account.without(name).reweighed(), name in account.steps
        enough = enough_for(name, account)
        if account.gain_over(without)[0] < enough / INEXACT:
            without = without.settled()
        # beside an event others were looked for where it is not
        for other in without.steps if anew else ():
            without = begun_again(without, other, nothing)
        # led astray by what is missing, the others may predict worse than nothing
        without = max(without, nothing, key=lambda a: a.nats)
        if name != newest.name and anew:
            account = better(account, own_options(without.quick(), name))
        elif name != newest.name:
            account = begun_again(account, name, nothing)
        adds[name] = account.gain_over(without)[0]
        needless = adds[name] < enough or is_nothing(account, name)
        if needless or (anew and stands_for_shape(account, without, adds[name])):
            account, adds = without, {}
    return account, adds
