#pragma once
// Threads that wait between steps, so that a step starts none and takes no memory.

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <thread>
#include <type_traits>
#include <vector>

namespace fastsim {

class Workers {
  public:
    // Pre-condition: at least 1; the calling thread is one of them.
    explicit Workers(std::size_t num_threads);
    ~Workers();
    Workers(const Workers &) = delete;
    Workers &operator=(const Workers &) = delete;

    [[nodiscard]] std::size_t count() const { return _threads.size() + 1; }

    // Calls task(0) here and task(1), task(2), ... on the others; returns when all are done.
    // Throws what a task threw, the lowest one's.
    template <typename Task> void run(Task &&task) {
        if (_threads.empty()) {
            task(std::size_t{0});
            return;
        }
        _task = &task;
        _call = [](void *given, std::size_t worker) {
            (*static_cast<std::remove_reference_t<Task> *>(given))(worker);
        };
        start_and_wait();
    }

    // The same, with the numbers below `size` handed out in turn: task(worker, number).
    template <typename Task> void hand_out(std::size_t size, Task &&task) {
        // Runs of numbers: few enough to be cheap, enough for all to have their part.
        constexpr std::size_t run_length = 16;
        std::atomic<std::size_t> next{0};
        run([&](std::size_t worker) {
            for (std::size_t first = 0; (first = next.fetch_add(run_length)) < size;)
                for (std::size_t k = first; k < std::min(first + run_length, size); ++k)
                    task(worker, k);
        });
    }

  private:
    void start_and_wait();
    void work(std::size_t worker);

    std::vector<std::thread> _threads;
    std::vector<std::exception_ptr> _errors;
    void *_task = nullptr;
    void (*_call)(void *, std::size_t) = nullptr;
    std::atomic<std::uint32_t> _turn{0}; // another one has begun, or the end
    std::atomic<std::uint32_t> _busy{0};
    bool _is_over = false;
};

} // namespace fastsim
