#include "tests/firmware/fault_world.h"

#include <algorithm>
#include <random>
#include <utility>
#include <vector>

#include "controller/devices/extruder_link.h"
#include "tools/rig/faulty_wire.h"

namespace reforge {
namespace {

constexpr int64_t kTroubleMs = 4000;      // how long a script's trouble lasts
constexpr int64_t kAgreementMs = 60'000;  // and how long agreeing again may take
constexpr int64_t kFreshMs = 1200;        // two heartbeats
// The dead-men (extruder_wire.h), and what the loop, the debouncing of a look and a ramp add.
constexpr int64_t kExtrusionSilenceMs = 500;
constexpr int64_t kSilenceMs = 3000;
constexpr int64_t kSlackMs = 15;
constexpr int64_t kWatchdogMs = 1100;  // outputs of a hanging chip stay as they were
constexpr int64_t kGapMs = 18;         // the board's 20 begin within the millisecond before ours
// An M73 that is lost is sent again five times, then the host starves the board.
constexpr int64_t kUnwantedMs = 2000;

class World {
 public:
  World(TriedBoard& board, const RigDescription& rig, uint64_t seed)
      : board_(board),
        random_(seed),
        link_(rig, ExtruderTimes{}, static_cast<uint16_t>(1 + seed % 60'000)),
        to_board_(2 * seed),
        to_host_(2 * seed + 1) {}

  ScriptOutcome run() {
    link_.opened(now());
    run_until(600);
    give({70, 205});
    run_until(1500 + pick(1500));
    noise();
    const int64_t end = ms_ + kTroubleMs;
    while (ms_ < end && !out_.wrong) {
      trouble();
      run_until(ms_ + 1 + pick(400));
    }
    agree();
    out_.faults += to_board_.faults() + to_host_.faults();
    out_.virtual_ms = ms_;
    return std::move(out_);
  }

 private:
  Instant now() const { return std::chrono::milliseconds(ms_); }
  int64_t pick(int64_t below) {
    return static_cast<int64_t>(random_() % static_cast<uint64_t>(below));
  }
  void wrong(const std::string& what) {
    if (!out_.wrong) out_.wrong = "at " + std::to_string(ms_) + " ms: " + what;
  }

  void give(const ExtruderOrder& order) {
    if (!link_.identified()) return;
    if (order.m_code == 72) {
      wanted_ = true;
    } else if (order.m_code == 71 || order.m_code == 73) {
      if (std::exchange(wanted_, false)) unwanted_since_ = ms_;
    }
    ++out_.orders;
    link_.order(now(), order);
  }

  void noise() {
    static constexpr double kRates[] = {0, 1e-3, 1e-2, 5e-2};
    for (FaultyWire* wire : {&to_board_, &to_host_}) {
      const double rate = kRates[pick(4)];
      wire->set_noise({rate, rate, rate, pick(3) == 0 ? pick(60) * kNsPerMs : 0});
    }
  }

  void trouble() {
    static constexpr BoardMishap kMishaps[] = {
        BoardMishap::kReset,       BoardMishap::kBrownOut,       BoardMishap::kPowerCycle,
        BoardMishap::kHang,        BoardMishap::kSensorOpen,     BoardMishap::kSensorShort,
        BoardMishap::kFilamentOut, BoardMishap::kSensorFallenOut};
    FaultyWire& wire = pick(2) ? to_board_ : to_host_;
    switch (pick(16)) {
      case 0:
        return give({70, 205});
      case 1:
      case 2:
      case 3:
        return give({72, 0.2 + 0.1 * static_cast<double>(pick(30))});
      case 4:
      case 5:
        return give({73});
      case 6:
        return give({74, 0.1 * static_cast<double>(1 + pick(20))});
      case 7:
        return give({75});
      case 8:
        return give({71});
      case 9:
        return wire.drop(static_cast<int>(1 + pick(60)));
      case 10:
        return wire.flip(static_cast<int>(1 + pick(5)));
      case 11:
        return wire.duplicate(static_cast<int>(1 + pick(60)));
      case 12:
        return stall(wire);
      case 13:
        link_.closed();
        lose_host();
        to_board_.drop(static_cast<int>(pick(10)));
        return link_.opened(now());
      case 14:
        if (pick(3) == 0) link_.clear_fault(now());
        return;
      default:
        ++out_.faults;
        const BoardMishap mishap = kMishaps[pick(8)];
        board_.suffer(mishap);
        if (mishap <= BoardMishap::kPowerCycle) heard_ = {};
        if (mishap == BoardMishap::kHang) hung_until_ = ms_ + kWatchdogMs;
        return;
    }
  }

  // What waits in a stalled wire is as if it had been sent when it comes out.
  void stall(FaultyWire& wire) {
    const int64_t until = ms_ + pick(4000);
    wire.stall(until * kNsPerMs);
    if (&wire == &to_board_) stalled_until_ = std::max(stalled_until_, until);
  }

  void lose_host() {
    if (std::exchange(wanted_, false)) unwanted_since_ = ms_;
  }

  void run_until(int64_t ms) {
    while (ms_ < ms && !out_.wrong) step();
  }

  void step() {
    ++ms_;
    take(link_.tick(now()));
    to_board_.send(link_.take_output(), ms_ * kNsPerMs);
    const std::string in = to_board_.take(ms_ * kNsPerMs);
    listen(in);
    board_.receive(in);
    board_.advance_1ms();
    to_host_.send(board_.take_bytes(), ms_ * kNsPerMs);
    take(link_.receive(now(), to_host_.take(ms_ * kNsPerMs)));
    judge();
  }

  void take(const std::vector<ExtruderLink::Event>& events) {
    for (const auto& event : events) {
      const bool fault = std::holds_alternative<ExtruderLink::Fault>(event);
      const bool lost = std::holds_alternative<ExtruderLink::Lost>(event);
      const bool refused = std::holds_alternative<ExtruderLink::Refused>(event);
      if (fault || lost) lose_host();
      if (refused && wanted_) give({73});  // as the daemon does
      if (lost) {
        link_.closed();
        link_.opened(now());
      }
      if (const auto* done = std::get_if<ExtruderLink::Done>(&event)) {
        done_ = done->order.m_code;
        done_ms_ = ms_;
      }
    }
  }

  // What the board can have understood: whole frames, as a decoder of our own finds them.
  void listen(std::string_view bytes) {
    wire::Frame frame;
    if (ms_ - last_byte_ms_ >= kGapMs && heard_.in_frame()) {
      heard_.gap();
      while (heard_.take(frame)) last_frame_ms_ = ms_;
    }
    for (const char c : bytes) {
      last_byte_ms_ = ms_;
      heard_.push(static_cast<uint8_t>(c));
      while (heard_.take(frame)) last_frame_ms_ = ms_;
    }
  }

  void judge() {
    const int64_t position = board_.position();
    const int64_t moved = position - std::exchange(position_, position);
    if (moved > 0) out_.steps += moved;
    if (moved < 0) out_.steps -= moved;
    const int64_t silence = ms_ - last_frame_ms_;
    if (moved != 0 && silence > kExtrusionSilenceMs + kSlackMs) {
      wrong("filament moves after " + std::to_string(silence) + " ms of silence");
    }
    if (ms_ <= hung_until_) return;
    if (board_.may_heat() && silence > kSilenceMs + kSlackMs) {
      wrong("the heater is on after " + std::to_string(silence) + " ms of silence");
    }
    if (board_.run_permitted() && silence > kSilenceMs + kSlackMs) {
      wrong("the CNC may run after " + std::to_string(silence) + " ms of silence");
    }
    if (moved != 0 && !board_.module_open()) wrong("filament moves with the module closed");
    if (moved > 0 && !wanted_ && ms_ - std::max(unwanted_since_, stalled_until_) > kUnwantedMs) {
      wrong("filament is pushed and nobody wants it");
    }
  }

  // The trouble is over: clean wires, whole sensor, filament. Then both must come to one mind.
  void agree() {
    for (FaultyWire* wire : {&to_board_, &to_host_}) {
      wire->set_noise({});
      wire->stall(0);
      wire->take(ms_ * kNsPerMs + kNsPerSecond);  // what is still inside is lost with the old cable
    }
    board_.suffer(BoardMishap::kSensorConnected);
    board_.suffer(BoardMishap::kFilamentIn);
    link_.closed();
    lose_host();
    link_.opened(now());
    const int64_t end = ms_ + kAgreementMs;
    done_ = 0;
    int64_t ordered_ms = -5000;
    while (ms_ < end && !out_.wrong) {
      step();
      if (!link_.identified()) continue;
      const wire::Status& status = *link_.status();
      if (status.state == wire::State::kFault && !link_.busy()) {
        link_.clear_fault(now());
      } else if (done_ == 71 && status.state == wire::State::kClosed && !link_.busy()) {
        if (ms_ - done_ms_ < kFreshMs) continue;  // what the host knows may be older than that
        if (status.position != board_.position_since_reset()) {
          wrong("the board reports step " + std::to_string(status.position) + ", its pin made " +
                std::to_string(board_.position_since_reset()));
        }
        return;
      } else if (!link_.busy() && ms_ - ordered_ms > 2000) {
        done_ = 0;
        ordered_ms = ms_;
        give({71});
      }
    }
    wrong("host and board do not agree again");
  }

  TriedBoard& board_;
  std::mt19937_64 random_;
  ExtruderLink link_;
  FaultyWire to_board_, to_host_;
  ScriptOutcome out_;
  int64_t ms_ = 0;
  bool wanted_ = false;  // M72 was ordered and nothing has ended it
  int64_t unwanted_since_ = -kUnwantedMs;
  int64_t position_ = 0;
  int done_ = 0;
  wire::Decoder heard_;
  int64_t done_ms_ = 0;
  int64_t stalled_until_ = 0, hung_until_ = 0;
  int64_t last_frame_ms_ = 0, last_byte_ms_ = 0;
};

}  // namespace

ScriptOutcome run_fault_script(TriedBoard& board, const RigDescription& rig, uint64_t seed) {
  return World(board, rig, seed).run();
}

}  // namespace reforge
