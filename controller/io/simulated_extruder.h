// A small extruder board in process, for `"backend": "simulated"`, dry runs and the core's tests:
// speaks protocols/extruder_wire.h, keeps its rules (sequence, acknowledge and done, dead-men), and
// does as told when told to misbehave. The real firmware runs in the virtual rig; here its word is
// enough.
//
// Times are the caller's. Each M-code takes a fixed time; the temperature does not move.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "controller/core/instant.h"
#include "protocols/extruder_wire.h"

namespace reforge {

class SimulatedExtruder {
 public:
  struct Executed {
    Instant at;
    int m_code;
    std::int32_t argument;
  };

  // Misbehaviour, set by the test at any time.
  bool mute = false;          // hears, but nothing it says arrives
  bool deaf = false;          // nothing arrives at it
  bool refuses_next = false;  // the next order is answered kTooCold
  bool forgets_done = false;  // kDone is never sent (a status still tells)
  bool never_finishes = false;

  SimulatedExtruder() {
    settings_[wire::Setting::kSilence] = 3000;
    settings_[wire::Setting::kInStream] = 0;
  }

  void power_cycle(Instant now) {
    auto kept = settings_;
    const auto log = executed;
    *this = SimulatedExtruder();
    settings_ = kept;
    executed = log;
    now_ = heard_ = now;
    say(pack(banner(), 0));
  }

  void receive(Instant now, std::string_view bytes) {
    advance(now);
    if (deaf) return;
    wire::Frame frame;
    for (const char c : bytes) {
      decoder_.push(static_cast<std::uint8_t>(c));
      while (decoder_.take(frame)) take(frame);
    }
  }

  void advance(Instant now) {
    now_ = now;
    if (busy_until_ && now >= *busy_until_ && !never_finishes) finish();
    const Instant silence = now - heard_;
    if (pushes() && silence > std::chrono::milliseconds(500)) latch(wire::Fault::kExtrusionSilence);
    if (state != wire::State::kClosed && state != wire::State::kStandby &&
        state != wire::State::kFault && silence > std::chrono::seconds(3)) {
      latch(wire::Fault::kSilence);
    }
  }

  // When something will happen without bytes; checked at least every 10 ms by the bench.
  Instant next_event() const { return busy_until_ && !never_finishes ? *busy_until_ : kNever; }

  void latch(wire::Fault fault) {
    if (state == wire::State::kFault) return;
    const wire::State before = state;
    state = wire::State::kFault;
    latched = fault;
    if (busy_until_) finish_with(wire::Reason::kFaulted);
    say(pack_fault(before));
  }

  std::string take_transmitted() {
    std::string out;
    out.swap(output_);
    return mute ? std::string() : out;
  }

  bool pushes() const {
    return state == wire::State::kExtruding || state == wire::State::kRestoring;
  }
  bool hot() const {
    return state != wire::State::kClosed && state != wire::State::kStandby &&
           state != wire::State::kFault && state != wire::State::kClosing;
  }

  wire::State state = wire::State::kClosed;
  wire::Fault latched = wire::Fault::kNone;
  std::vector<Executed> executed;  // orders taken for execution, in order
  int orders_heard = 0;            // repetitions included

 private:
  wire::Banner banner() const {
    return {wire::kProtocolVersion, 0, 1, 0, 2, 0, session_, state, latched};
  }

  wire::Frame pack_fault(wire::State before) const {
    return wire::Packer(wire::Type::kFault, 0)
        .u8(static_cast<std::uint8_t>(latched))
        .u8(static_cast<std::uint8_t>(before))
        .i16(2050)
        .i32(0)
        .frame();
  }

  void say(const wire::Frame& frame) {
    std::uint8_t bytes[wire::kFrameMax];
    const std::uint8_t n = encode(frame, bytes);
    output_.append(reinterpret_cast<const char*>(bytes), n);
  }

  void take(const wire::Frame& frame) {
    heard_ = now_;
    wire::Hello hello;
    wire::GetSetting get;
    if (unpack(frame, hello)) {
      if (hello.session != session_) {
        session_ = hello.session;
        last_ = 0;
        last_result_ = wire::Reason::kNone;
      }
      say(pack(banner(), frame.sequence));
    } else if (frame.type == wire::Type::kHeartbeat) {
      say(pack(wire::Beat{state, latched}, frame.sequence));
    } else if (frame.type == wire::Type::kStatusQuery) {
      say(pack(status(), frame.sequence));
    } else if (unpack(frame, get)) {
      say(pack(wire::SettingValue{get.id, settings_[get.id]}, frame.sequence));
    } else {
      take_order(frame);
    }
  }

  wire::Status status() const {
    wire::Status s{};
    s.state = state;
    s.fault = latched;
    s.flags = wire::kFlagRunPermitted;
    s.temperature = 2050;
    s.last_sequence = last_;
    s.last_result = last_result_;
    return s;
  }

  void take_order(const wire::Frame& frame) {
    ++orders_heard;
    const auto ack = [&](wire::Reason reason) {
      say(pack(wire::Ack{reason, state}, frame.sequence));
    };
    if (session_ == 0) return ack(wire::Reason::kNoHello);
    const auto ahead = static_cast<std::int8_t>(frame.sequence - last_);
    if (ahead < 0) return ack(wire::Reason::kStale);
    if (ahead == 0) {
      ack(last_ack_);
      if (last_ack_ == wire::Reason::kNone && !busy_until_) {
        say(pack(wire::Done{last_result_, state, 0}, last_));
      }
      return;
    }
    const wire::Reason reason = begin(frame);
    last_ = frame.sequence;
    last_ack_ = reason;
    last_result_ = reason == wire::Reason::kNone ? wire::Reason::kPending : reason;
    ack(reason);
    if (reason == wire::Reason::kNone && *busy_until_ <= now_) finish();
  }

  wire::Reason begin(const wire::Frame& frame) {
    wire::Command command;
    wire::SetSetting set;
    const bool stops = unpack(frame, command) && (command.m_code == 71 || command.m_code == 73);
    if (busy_until_ && !stops) return wire::Reason::kBusy;
    if (busy_until_) finish_with(wire::Reason::kSuperseded);
    if (refuses_next) {
      refuses_next = false;
      return wire::Reason::kTooCold;
    }
    after_ = state;
    if (unpack(frame, set)) {
      settings_[set.id] = set.value;
      busy_until_ = now_;
      return wire::Reason::kNone;
    }
    if (frame.type == wire::Type::kClearFault) {
      if (state == wire::State::kFault) after_ = wire::State::kStandby;
      clears_ = true;
      busy_until_ = now_;
      return wire::Reason::kNone;
    }
    if (!unpack(frame, command)) return wire::Reason::kUnknownCommand;
    return begin_m_code(command);
  }

  wire::Reason begin_m_code(const wire::Command& command) {
    using wire::Reason;
    using wire::State;
    if (state == State::kFault) return Reason::kFaultLatched;
    const bool ready = state == State::kReady;
    switch (command.m_code) {
      case 70:
        state = State::kOpening;
        after_ = State::kReady;
        busy_until_ = now_ + std::chrono::milliseconds(800);
        break;
      case 71:
        state = State::kClosing;
        after_ = State::kClosed;
        busy_until_ = now_ + std::chrono::milliseconds(300);
        break;
      case 72:
        if (!ready) return state == State::kRetracted ? Reason::kRetractionOn : Reason::kNotOpen;
        state = State::kRestoring;
        after_ = State::kExtruding;
        busy_until_ = now_ + std::chrono::milliseconds(40);
        break;
      case 73:
        if (state == State::kOpening) after_ = state = State::kStandby;
        if (pushes()) after_ = state = State::kReady;
        busy_until_ = now_ + std::chrono::milliseconds(5);
        break;
      case 74:
        if (!ready) return pushes() ? Reason::kExtrusionOn : Reason::kNotOpen;
        state = State::kRetracting;
        after_ = State::kRetracted;
        busy_until_ = now_ + std::chrono::milliseconds(60);
        break;
      case 75:
        if (state == State::kRetracted) after_ = State::kReady;
        busy_until_ = now_ + std::chrono::milliseconds(5);
        break;
      default:
        return Reason::kUnknownCommand;
    }
    executed.push_back({now_, command.m_code, command.argument});
    return Reason::kNone;
  }

  void finish() {
    state = after_;
    if (clears_) latched = wire::Fault::kNone;
    clears_ = false;
    finish_with(wire::Reason::kNone);
  }
  void finish_with(wire::Reason reason) {
    busy_until_.reset();
    last_result_ = reason;
    if (!forgets_done) say(pack(wire::Done{reason, state, 0}, last_));
  }

  Instant now_{};
  Instant heard_{};
  wire::Decoder decoder_;
  std::string output_;
  std::map<wire::Setting, std::int32_t> settings_;
  std::uint16_t session_ = 0;
  std::uint8_t last_ = 0;
  wire::Reason last_ack_ = wire::Reason::kNone;
  wire::Reason last_result_ = wire::Reason::kNone;
  std::optional<Instant> busy_until_;
  wire::State after_ = wire::State::kClosed;
  bool clears_ = false;
};

}  // namespace reforge
