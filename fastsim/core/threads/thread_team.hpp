#pragma once
// Threads that do the steps of a run together, and wait for each other within a step.

#include "threads/workers.hpp"

#include <array>
#include <memory>

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
        const std::size_t round = _round->count.load(std::memory_order_relaxed);
        if (_arrived->count.fetch_add(1, std::memory_order_acq_rel) + 1 == size()) {
            _arrived->count.store(0, std::memory_order_relaxed);
            _round->count.store(round + 1, std::memory_order_release);
            return;
        }
        for (int spins = 0; _round->count.load(std::memory_order_acquire) == round; ++spins)
            if (spins > 20000)
                std::this_thread::yield(); // more threads than processors
    }

  private:
    // Lines of their own, on the heap: whoever holds a team need not be aligned so.
    struct alignas(64) Counter {
        std::atomic<std::size_t> count{0};
    };
    Workers _workers;
    std::unique_ptr<Counter> _arrived = std::make_unique<Counter>();
    std::unique_ptr<Counter> _round = std::make_unique<Counter>();
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
