#include "threads/workers.hpp"

namespace fastsim {

Workers::Workers(std::size_t num_threads) : _errors(num_threads) {
    for (std::size_t worker = 1; worker < num_threads; ++worker)
        _threads.emplace_back([this, worker] { work(worker); });
}

Workers::~Workers() {
    _is_over = true;
    _turn.fetch_add(1);
    _turn.notify_all();
    for (std::thread &thread : _threads)
        thread.join();
}

void Workers::start_and_wait() {
    _busy.store(static_cast<std::uint32_t>(_threads.size()));
    _turn.fetch_add(1);
    _turn.notify_all();
    try {
        _call(_task, 0);
    } catch (...) {
        _errors[0] = std::current_exception();
    }
    for (std::uint32_t busy = _busy.load(); busy != 0; busy = _busy.load())
        _busy.wait(busy);
    for (std::exception_ptr &error : _errors)
        if (error) {
            const std::exception_ptr first = error;
            for (std::exception_ptr &other : _errors)
                other = nullptr;
            std::rethrow_exception(first);
        }
}

void Workers::work(std::size_t worker) {
    for (std::uint32_t seen = 0;;) {
        _turn.wait(seen);
        seen = _turn.load();
        if (_is_over)
            return;
        try {
            _call(_task, worker);
        } catch (...) {
            _errors[worker] = std::current_exception();
        }
        if (_busy.fetch_sub(1) == 1)
            _busy.notify_one();
    }
}

} // namespace fastsim
