"""The two buffers against the plainest account of them: one long array."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_hardware.card import Card
from sim_hardware.card.buffers import InputRing, OutputQueue
from sim_hardware.card.channels import parse_channels
from sim_hardware.card.task import CONTINUOUS, Timing
from sim_hardware.card.transfer import read, write

SIZES = st.integers(1, 40)
STEPS = st.lists(st.integers(0, 60), max_size=40)
UNHURRIED = settings(deadline=None)  # a busy computer is no failure


@UNHURRIED
@given(size=SIZES, steps=STEPS, data=st.data())
def test_a_ring_hands_out_every_sample_once_and_in_order(size, steps, data):
    ring, acquired, next_read = InputRing(2, size), 0, 0
    for n in steps:
        ring.store(np.arange(acquired, acquired + n) + np.array([[0.0], [0.5]]))
        acquired += n
        assert ring.overwritten == (acquired - next_read > size)
        if ring.overwritten:
            return
        taken = data.draw(st.integers(0, ring.available))
        block = ring.take(taken)
        assert np.array_equal(block[0], np.arange(next_read, next_read + taken))
        assert np.array_equal(block[1], block[0] + 0.5)
        next_read += taken


@UNHURRIED
@given(size=SIZES, steps=STEPS, data=st.data())
def test_a_queue_plays_every_sample_once_and_in_order(size, steps, data):
    queue, written, played = OutputQueue(1, size, regenerate=False), 0, 0
    for n in steps:
        put = min(data.draw(st.integers(0, size)), queue.room)
        queue.write(np.arange(written, written + put)[None] * 1.0)
        written += put
        block = queue.take(n)[0]
        assert np.array_equal(block, np.arange(played, min(played + n, written)))
        played += len(block)
        assert queue.room == size - (written - played)


@UNHURRIED
@given(wave=st.lists(st.floats(-10, 10), min_size=1, max_size=30), steps=STEPS)
def test_a_regenerating_queue_repeats_its_wave(wave, steps):
    queue = OutputQueue(1, len(wave), regenerate=True)
    queue.write(np.array([wave]))
    played = np.concatenate([np.zeros(0), *(queue.take(n)[0] for n in steps)])
    assert np.array_equal(played, np.resize(wave, len(played)) if len(played) else played)
    queue.rewind()
    assert queue.take(1)[0, 0] == wave[0]


@UNHURRIED
@given(steps=st.lists(st.integers(1, 50), min_size=1, max_size=20))
def test_how_time_is_cut_makes_no_difference(steps):
    class Echo:
        time_s = 0.0

        def advance(self, command_v):
            self.position_v, self.force_v = command_v, command_v
            return self

        def rest(self, duration_s):
            raise AssertionError

    card = Card(Echo(), virtual=True, late_start_samples=7)
    task, output = card.create("in"), card.create("out")
    card.add_channels(task, parse_channels("Dev1/ai2", "", "ai", -10, 10))
    card.set_timing(task, Timing(mode=CONTINUOUS))
    card.add_channels(output, parse_channels("Dev1/ao0", "", "ao", -10, 10))
    card.set_timing(output, Timing(n_samples=100))
    card.set_start_trigger(output, "/Dev1/ai/StartTrigger")
    wave = card.converter.convert(np.linspace(1, 2, 100))
    write(card, output, wave[None], auto_start=True, timeout_s=0)
    card.start(task)
    heard = np.concatenate([read(card, task, n, 1.0)[0] for n in steps])
    expected = np.concatenate([np.zeros(7), wave, np.full(len(heard), wave[-1])])[: len(heard)]
    assert np.array_equal(heard, expected)
