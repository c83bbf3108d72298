#pragma once
// What long work asks now and then: whether its time is up. Who waits is told how far it is.

#include <chrono>
#include <cstddef>
#include <functional>
#include <string>
#include <utility>

namespace fastsim {

/// Thrown by Watch when the time is up; caught by whoever began the work.
struct TimeUp {
    std::string stage;
};

class Watch {
  public:
    /// Called with the name of a stage and the number of things to do in it as it begins, and
    /// several times a second with 0 and the part of it that is done, 0 to 1; may throw to end the
    /// work.
    using Tell = std::function<void(const std::string &stage, std::size_t amount, double done)>;

    /// No limit, and nobody is told.
    Watch() = default;
    Watch(double seconds, Tell tell)
        : _end(Clock::now() + std::chrono::duration<double>(seconds)), _tell(std::move(tell)) {}

    void begin(const char *stage, std::size_t amount) {
        _stage = stage;
        _amount = amount;
        _num_done = 0;
        _done = 0.0;
        if (_tell)
            _tell(_stage, amount, 0.0);
        look();
    }

    /// One more of the things to do is done.
    void count() {
        ++_num_done;
        reach(static_cast<double>(_num_done) / static_cast<double>(_amount));
    }

    /// A part of the stage is done, 0 to 1.
    void reach(double done) {
        _done = done;
        look();
    }

    void look() {
        if (!_tell)
            return;
        const Time now = Clock::now();
        if (now > _end)
            throw TimeUp{_stage};
        if (now > _next) {
            _next = now + std::chrono::milliseconds(200);
            _tell(_stage, 0, _done);
        }
    }

  private:
    using Clock = std::chrono::steady_clock;
    using Time = std::chrono::time_point<Clock, std::chrono::duration<double>>;

    Time _end{}, _next{};
    Tell _tell;
    std::string _stage;
    std::size_t _amount = 0, _num_done = 0;
    double _done = 0.0;
};

} // namespace fastsim
