#pragma once
// Threads that do the steps of a run together, and wait for each other within a step.

#include "threads/workers.hpp"

#include <array>

namespace fastsim {

class ThreadTeam {
  public:
    explicit ThreadTeam(std::size_t num_threads) : _workers(num_threads) {}

    std::size_t size() const { return _workers.count(); }

    /// Calls task(0) here and task(1), task(2), ... on the others; returns when all are done.
    template <typename Task> void run(Task &&task) { _workers.run(task); }

    /// Within `run`: all threads wait for the last one; spins, since a step is quick.
    void wait() {
        if (size() == 1)
            return;
        const std::size_t round = _round.load(std::memory_order_relaxed);
        if (_arrived.fetch_add(1, std::memory_order_acq_rel) + 1 == size()) {
            _arrived.store(0, std::memory_order_relaxed);
            _round.store(round + 1, std::memory_order_release);
            return;
        }
        for (int spins = 0; _round.load(std::memory_order_acquire) == round; ++spins)
            if (spins > 20000)
                std::this_thread::yield(); // more threads than processors
    }

  private:
    Workers _workers;
    alignas(64) std::atomic<std::size_t> _arrived{0};
    alignas(64) std::atomic<std::size_t> _round{0};
};

/// What each thread has seen in a step; read once all have spoken. Two slots, used in turn: a fast
/// thread never overwrites what is being read.
template <typename Seen> class Votes {
  public:
    explicit Votes(std::size_t num_threads) : _ballots(num_threads) {}

    void cast(std::size_t thread, std::size_t step, Seen seen) {
        _ballots[thread].seen[step % 2] = seen;
    }
    /// The first that is not Seen{}.
    Seen result(std::size_t step) const {
        for (const Ballot &ballot : _ballots)
            if (ballot.seen[step % 2] != Seen{})
                return ballot.seen[step % 2];
        return Seen{};
    }

  private:
    struct alignas(64) Ballot {
        std::array<Seen, 2> seen{};
    };
    std::vector<Ballot> _ballots;
};

} // namespace fastsim
