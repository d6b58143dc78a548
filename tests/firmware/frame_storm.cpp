#include "tests/firmware/frame_storm.h"

#include <memory>
#include <random>

#include "tests/firmware/desk.h"

namespace reforge {
namespace {

using wire::Frame;
using wire::State;
using wire::Type;

constexpr int64_t kFramesPerBoard = 500;  // then a fresh one
constexpr uint32_t kGapMs = 25;  // a frame hidden in what was spoiled is found after a pause

class Storm {
 public:
  explicit Storm(uint64_t seed) : random_(seed) {}

  FrameOutcome run(int64_t frames) {
    while (out_.frames < frames) {
      fresh_board();
      for (int64_t i = 0; i < kFramesPerBoard && out_.frames < frames; ++i) {
        ++out_.frames;
        throw_one();
        wait();
      }
    }
    return out_;
  }

 private:
  uint32_t pick(uint32_t below) { return static_cast<uint32_t>(random_() % below); }

  void wrong(const char* what) {
    if (out_.wrong++ == 0) out_.first = "frame " + std::to_string(out_.frames) + ": " + what;
  }

  void fresh_board() {
    desk_ = std::make_unique<Desk>();
    desk_->silent = true;
    desk_->by_link = true;
    desk_->settings.set(wire::Setting::kModuleTravel, 50);
    desk_->hot_end.set_temperature(205);
    moved_to_ = 0;
    last_valid_ms_ = 0;
    run_ms(200);
    desk_->greet();
    sequence_ = 0;
    last_valid_ms_ = desk_->now_ms;
    if (pick(4) != 0) {  // most boards are hot and open
      order(pack(wire::Command{70, 2050}, 0));
      for (int i = 0; i < 6; ++i) {
        run_ms(250);
        beat();
      }
    }
  }

  void beat() { send(wire::pack(Type::kHeartbeat, 1)); }
  void send(const Frame& frame) {
    ++out_.valid;
    last_valid_ms_ = desk_->now_ms;
    desk_->send(frame);
    for (const Frame& answer : desk_->take_frames()) {
      wire::Ack ack;
      if (unpack(answer, ack) && ack.reason == wire::Reason::kNone) ++out_.taken;
    }
  }
  void order(Frame frame) {
    frame.sequence = ++sequence_;
    send(frame);
  }

  int32_t argument() {
    static constexpr int32_t kEdges[] = {
        0, 1, -1, 350, 2050, 20'000, 100'001, 0x7FFFFFFF, static_cast<int32_t>(0x80000000)};
    return pick(2) ? kEdges[pick(9)] : static_cast<int32_t>(random_());
  }

  void throw_one() {
    Frame frame;
    switch (pick(10)) {
      case 0:
      case 1:
      case 2:
      case 3: {  // sensible orders, mostly
        const uint8_t code = static_cast<uint8_t>(70 + pick(6));
        return order(pack(wire::Command{code, pick(3) ? 0 : argument()}, 0));
      }
      case 4:
        return order(
            pick(2) ? wire::pack(Type::kClearFault, 0)
                    : pack(wire::SetSetting{static_cast<wire::Setting>(pick(30)), argument()}, 0));
      case 5:
        return beat();
      case 6: {  // a frame nobody would send, with a right CRC
        frame.type = static_cast<Type>(pick(256));
        frame.length = static_cast<uint8_t>(pick(wire::kPayloadMax + 1));
        for (uint8_t i = 0; i < frame.length; ++i)
          frame.payload[i] = static_cast<uint8_t>(pick(256));
        frame.sequence = static_cast<uint8_t>(pick(256));
        // An order far ahead would make all that follow stale.
        if (frame.type >= Type::kCommand && frame.type <= Type::kSaveSettings) {
          frame.sequence = ++sequence_;
        }
        send(frame);
        if (frame.type == Type::kHello) {
          desk_->greet();
          sequence_ = 0;
        }
        return;
      }
      default:
        return spoiled();
    }
  }

  // A sound frame with bytes flipped, lost, doubled, or cut off; sometimes only noise.
  void spoiled() {
    uint8_t bytes[2 * wire::kFrameMax];
    uint8_t count = 0;
    if (pick(5) == 0) {
      count = static_cast<uint8_t>(1 + pick(wire::kFrameMax));
      for (uint8_t i = 0; i < count; ++i) bytes[i] = static_cast<uint8_t>(pick(256));
    } else {
      Frame frame = pack(wire::Command{static_cast<uint8_t>(70 + pick(6)), argument()},
                         static_cast<uint8_t>(sequence_ + pick(3)));
      count = encode(frame, bytes);
      const uint8_t at = static_cast<uint8_t>(pick(count));
      if (pick(3) == 0) {
        bytes[at] = static_cast<uint8_t>(bytes[at] ^ (1u << pick(8)));
      } else if (pick(2) == 0) {
        for (uint8_t i = at; i + 1 < count; ++i) bytes[i] = bytes[i + 1];
        --count;
      } else {
        count = at;
      }
    }
    wire::Decoder judge = judge_;
    Frame frame;
    for (uint8_t i = 0; i < count; ++i) {
      desk_->link.receive(bytes[i], desk_->now_ms);
      judge.push(bytes[i]);
      while (judge.take(frame)) understood(frame);
    }
    judge_ = judge;
  }

  void understood(const Frame& frame) {
    ++out_.valid;
    last_valid_ms_ = desk_->now_ms;
    if (frame.sequence == static_cast<uint8_t>(sequence_ + 1)) ++sequence_;
  }

  void wait() {
    const uint32_t kind = pick(40);
    if (kind == 0) {
      run_ms(3200);  // the dead-men
    } else if (kind == 1) {
      desk_->hot_end.set_temperature(20 + pick(280));
      run_ms(70);
    } else if (kind == 2) {
      static constexpr SensorWiring kWirings[] = {SensorWiring::kConnected,
                                                  SensorWiring::kConnected, SensorWiring::kOpen,
                                                  SensorWiring::kShort};
      desk_->hot_end.set_sensor(kWirings[pick(4)]);
      run_ms(250);
    } else if (kind == 3) {
      desk_->filament = pick(3) != 0;
      run_ms(50);
    } else if (kind == 4) {
      desk_->hot_end.set_sensor(SensorWiring::kConnected);
      desk_->hot_end.set_temperature(205);
      run_ms(210);
    } else {
      run_ms(pick(25));
    }
  }

  void run_ms(uint32_t ms) {
    for (; ms > 0; --ms) {
      desk_->run_ms(1);
      desk_->timer.forget_steps();
      judge();
    }
    judge_ = {};
  }

  void judge() {
    Desk& desk = *desk_;
    const State state = desk.extruder.state();
    const bool cold = state == State::kFault || state == State::kClosed || state == State::kStandby;
    const bool moved = desk.timer.position() != moved_to_;
    moved_to_ = desk.timer.position();
    if (cold && desk.heater.heating()) wrong("heating in a state that may not");
    if (cold && desk.feeder.moving()) wrong("moving in a state that may not");
    if (moved && desk.extruder.module() != firmware::Module::kOpen) wrong("moving while closed");
    if (state == State::kFault && desk.extruder.run_permitted()) wrong("a fault permits the CNC");
    if (desk.extruder.position() != desk.timer.position())
      wrong("steps reported are not those made");
    if (desk.extruder.retracted() < 0) wrong("retracted length below zero");
    // Settings are fuzzed too: the deadlines are the board's own.
    const auto limit = [&](wire::Setting id) {
      return static_cast<uint32_t>(desk.settings.get(id)) + 2;
    };
    const bool host = desk.settings.get(wire::Setting::kInStream) == 0;
    const uint32_t heard_ms = last_valid_ms_ + kGapMs;
    const uint32_t silence = desk.now_ms > heard_ms ? desk.now_ms - heard_ms : 0;
    if (host && moved && silence > limit(wire::Setting::kExtrusionSilence)) {
      wrong("moving in spite of silence");
    }
    if (host && desk.heater.heating() && silence > limit(wire::Setting::kSilence)) {
      wrong("heating in spite of silence");
    }
  }

  std::mt19937_64 random_;
  std::unique_ptr<Desk> desk_;
  FrameOutcome out_;
  uint8_t sequence_ = 0;
  uint32_t last_valid_ms_ = 0;
  int64_t moved_to_ = 0;
  wire::Decoder judge_;
};

}  // namespace

FrameOutcome run_frame_storm(int64_t frames, uint64_t seed) {
  return Storm(seed).run(frames);
}

}  // namespace reforge
