// The board's end of the link: hello, sequence, duplicates, settings, full rings; terminal and
// store.

#include "firmware/arduino-extruder/link.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <string>
#include <vector>

#include "tests/firmware/desk.h"

namespace reforge::firmware {
namespace {

using wire::Frame;
using wire::Reason;
using wire::Setting;
using wire::State;
using wire::Type;

Frame m(uint8_t m_code, uint8_t sequence, int32_t argument = wire::kUseSetting) {
  return pack(wire::Command{m_code, argument}, sequence);
}

template <typename Message>
Message only(const std::vector<Frame>& frames, Type type, uint8_t sequence) {
  Message message = {};
  int count = 0;
  for (const Frame& frame : frames) {
    if (frame.type != type || frame.sequence != sequence) continue;
    ++count;
    EXPECT_TRUE(unpack(frame, message));
  }
  EXPECT_EQ(count, 1);
  return message;
}

int count_of(const std::vector<Frame>& frames, Type type) {
  return static_cast<int>(std::count_if(frames.begin(), frames.end(),
                                        [type](const Frame& f) { return f.type == type; }));
}

Reason refusal(Desk& desk, const Frame& frame) {
  desk.take_frames();
  desk.send(frame);
  return only<wire::Ack>(desk.take_frames(), Type::kAck, frame.sequence).reason;
}

TEST(Link, ObeysNothingBeforeAHello) {
  Desk desk;
  EXPECT_EQ(refusal(desk, m(70, 1)), Reason::kNoHello);
  EXPECT_EQ(desk.extruder.state(), State::kClosed);
  desk.greet();
  EXPECT_EQ(refusal(desk, m(70, 1)), Reason::kNone);
}

TEST(Link, SaysItsBannerUnaskedAndWhenGreeted) {
  Desk desk;
  desk.by_link = true;
  desk.run_ms(1);
  EXPECT_EQ(only<wire::Banner>(desk.take_frames(), Type::kBanner, 0).session, 0);
  desk.send(pack(wire::Hello{wire::kProtocolVersion, 513}, 44));
  const wire::Banner banner = only<wire::Banner>(desk.take_frames(), Type::kBanner, 44);
  EXPECT_EQ(banner.session, 513);
  EXPECT_EQ(banner.config_hash, desk.settings.hash());
  EXPECT_EQ(banner.reset_cause, wire::kResetPowerOn);
}

TEST(Link, AnotherVersionIsRefused) {
  Desk desk;
  desk.send(pack(wire::Hello{wire::kProtocolVersion + 1, 7}, 0));
  EXPECT_EQ(only<wire::Ack>(desk.take_frames(), Type::kAck, 0).reason, Reason::kWrongVersion);
  desk.send(pack(wire::Hello{wire::kProtocolVersion, 0}, 0));
  EXPECT_EQ(only<wire::Ack>(desk.take_frames(), Type::kAck, 0).reason, Reason::kWrongVersion);
  EXPECT_EQ(refusal(desk, m(71, 1)), Reason::kNoHello);
}

TEST(Link, AnOrderTwiceIsAnsweredTwiceAndDoneOnce) {
  Desk desk;
  desk.greet();
  desk.open_hot();
  desk.take_frames();
  desk.send(m(74, 1, 1000));
  desk.send(m(74, 1, 1000));
  EXPECT_EQ(count_of(desk.take_frames(), Type::kAck), 2);
  desk.run_ms(500);
  EXPECT_EQ(count_of(desk.take_frames(), Type::kDone), 1);
  const int32_t position = desk.extruder.position();
  desk.send(m(74, 1, 1000));
  const std::vector<Frame> again = desk.take_frames();
  EXPECT_EQ(count_of(again, Type::kAck), 1);
  EXPECT_EQ(only<wire::Done>(again, Type::kDone, 1).position, position);
  desk.run_ms(500);
  EXPECT_EQ(desk.extruder.position(), position);
}

TEST(Link, ARefusalIsNotThoughtOverWhenRepeated) {
  Desk desk;
  desk.greet();
  EXPECT_EQ(refusal(desk, m(72, 1)), Reason::kNotOpen);
  desk.open_hot();
  EXPECT_EQ(refusal(desk, m(72, 1)), Reason::kNotOpen);
  EXPECT_EQ(desk.extruder.state(), State::kReady);
}

TEST(Link, OldOrdersAreStaleAndNumbersWrap) {
  Desk desk;
  desk.greet();
  for (int i = 1; i < 600; ++i) {
    const uint8_t sequence = static_cast<uint8_t>(i);
    ASSERT_EQ(refusal(desk, m(73, sequence)), Reason::kNone) << i;
    ASSERT_EQ(refusal(desk, m(70, static_cast<uint8_t>(sequence - 1))), Reason::kStale) << i;
  }
  EXPECT_EQ(desk.extruder.state(), State::kClosed);
}

TEST(Link, TheSameHelloAgainForgetsNothing) {
  Desk desk;
  desk.greet();
  EXPECT_EQ(refusal(desk, m(73, 1)), Reason::kNone);
  desk.greet();
  EXPECT_EQ(refusal(desk, m(70, 0)), Reason::kStale);
  desk.send(pack(wire::Hello{wire::kProtocolVersion, 8}, 0));  // a new session
  EXPECT_EQ(refusal(desk, m(73, 1)), Reason::kNone);
  EXPECT_EQ(refusal(desk, m(73, 2)), Reason::kNone);
}

TEST(Link, OneOrderAtATimeButAStopIsAlwaysTaken) {
  Desk desk;
  desk.greet();
  desk.run_ms(200);
  desk.send(m(70, 1));
  EXPECT_EQ(refusal(desk, m(74, 2)), Reason::kBusy);
  EXPECT_EQ(refusal(desk, pack(Type::kClearFault, 3)), Reason::kBusy);
  desk.send(m(71, 4));
  const std::vector<Frame> frames = desk.take_frames();
  EXPECT_EQ(only<wire::Done>(frames, Type::kDone, 1).reason, Reason::kSuperseded);
  EXPECT_EQ(only<wire::Ack>(frames, Type::kAck, 4).reason, Reason::kNone);
  desk.run_ms(2000);
  EXPECT_EQ(only<wire::Done>(desk.take_frames(), Type::kDone, 4).state, State::kClosed);
}

TEST(Link, AFaultEndsTheOrderAndIsReported) {
  Desk desk;
  desk.greet();
  desk.hot_end.set_temperature(100);
  desk.run_ms(200);
  desk.send(m(70, 1));
  desk.hot_end.set_sensor(SensorWiring::kShort);
  desk.take_frames();
  desk.run_ms(400);
  const std::vector<Frame> frames = desk.take_frames();
  EXPECT_EQ(only<wire::Done>(frames, Type::kDone, 1).reason, Reason::kFaulted);
  EXPECT_EQ(only<wire::FaultReport>(frames, Type::kFault, 0).fault, wire::Fault::kSensorShort);
  EXPECT_EQ(refusal(desk, m(70, 2)), Reason::kFaultLatched);
  desk.hot_end.set_sensor(SensorWiring::kConnected);
  desk.run_ms(200);
  EXPECT_EQ(refusal(desk, pack(Type::kClearFault, 3)), Reason::kNone);
  desk.send(wire::pack(Type::kHeartbeat, 9));
  EXPECT_EQ(only<wire::Beat>(desk.take_frames(), Type::kBeat, 9).state, State::kStandby);
}

TEST(Link, StatusSaysWhatIsSo) {
  Desk desk;
  desk.greet();
  desk.open_hot();
  desk.send(m(72, 1, 1500));
  desk.run_ms(1000);
  desk.take_frames();
  desk.send(wire::pack(Type::kStatusQuery, 9));
  const wire::Status status = only<wire::Status>(desk.take_frames(), Type::kStatus, 9);
  EXPECT_EQ(status.state, State::kExtruding);
  EXPECT_EQ(status.flags, wire::kFlagFilamentPresent | wire::kFlagModuleOpen | wire::kFlagHeating |
                              wire::kFlagRunPermitted);
  EXPECT_NEAR(status.temperature, 2050, 10);
  EXPECT_EQ(status.target, 2050);
  EXPECT_EQ(status.position, desk.timer.position());
  EXPECT_EQ(status.speed, 1500);
  EXPECT_EQ(status.last_sequence, 1);
  EXPECT_EQ(status.last_result, Reason::kNone);
  EXPECT_EQ(status.uptime, desk.now_ms);
}

TEST(Link, SettingsAreSetReadAndBounded) {
  Desk desk;
  desk.greet();
  const uint16_t hash = desk.settings.hash();
  desk.send(pack(wire::SetSetting{Setting::kStepsPerMetre, 100'000}, 1));
  EXPECT_EQ(only<wire::Done>(desk.take_frames(), Type::kDone, 1).reason, Reason::kNone);
  EXPECT_NE(desk.settings.hash(), hash);
  desk.send(pack(wire::GetSetting{Setting::kStepsPerMetre}, 50));
  EXPECT_EQ(only<wire::SettingValue>(desk.take_frames(), Type::kSettingValue, 50).value, 100'000);
  EXPECT_EQ(refusal(desk, pack(wire::SetSetting{Setting::kStepsPerMetre, 1}, 2)),
            Reason::kBadArgument);
  const auto none = static_cast<Setting>(wire::kSettingCount);
  EXPECT_EQ(refusal(desk, pack(wire::SetSetting{none, 1}, 3)), Reason::kUnknownSetting);
  EXPECT_EQ(refusal(desk, pack(wire::GetSetting{none}, 4)), Reason::kUnknownSetting);
  desk.open_hot();
  EXPECT_EQ(refusal(desk, pack(wire::SetSetting{Setting::kPidP, 1}, 5)), Reason::kNotIdle);
  EXPECT_EQ(refusal(desk, pack(Type::kSaveSettings, 6)), Reason::kNotIdle);
}

TEST(Link, OrdersWithWrongPayloadsAreUnknown) {
  Desk desk;
  desk.greet();
  Frame frame = m(71, 1);
  frame.length = 4;
  EXPECT_EQ(refusal(desk, frame), Reason::kUnknownCommand);
  frame = wire::pack(Type::kSaveSettings, 2);
  frame.length = 1;
  EXPECT_EQ(refusal(desk, frame), Reason::kUnknownCommand);
  desk.send(wire::pack(static_cast<Type>(0x55), 3));  // nothing of ours: no answer
  EXPECT_TRUE(desk.take_frames().empty());
}

TEST(Link, InStreamTakesStopsOnly) {
  Desk desk;
  desk.greet();
  desk.settings.set(Setting::kInStream, 1);
  EXPECT_EQ(refusal(desk, m(70, 1)), Reason::kInStreamOnly);
  EXPECT_EQ(refusal(desk, m(73, 2)), Reason::kNone);
  EXPECT_EQ(refusal(desk, m(71, 3)), Reason::kNone);
}

TEST(Link, ABrokenFrameIsGivenUpAfterAPause) {
  Desk desk;
  desk.greet();
  desk.link.receive(wire::kSync, desk.now_ms);
  desk.link.receive(20, desk.now_ms);
  desk.run_ms(30);
  desk.send(wire::pack(Type::kHeartbeat, 9));
  EXPECT_EQ(count_of(desk.take_frames(), Type::kBeat), 1);
  // A whole frame caught behind a false start comes out with the pause.
  desk.link.receive(wire::kSync, desk.now_ms);
  desk.link.receive(20, desk.now_ms);
  desk.send(wire::pack(Type::kHeartbeat, 10));
  EXPECT_EQ(count_of(desk.take_frames(), Type::kBeat), 0);
  desk.run_ms(30);
  EXPECT_EQ(count_of(desk.take_frames(), Type::kBeat), 1);
}

TEST(Link, ADoneWaitsForRoomInTheRing) {
  Desk desk;
  desk.greet();
  desk.open_hot();
  desk.run_ms(1);
  while (desk.out.room() > 8) desk.out.push('x');  // an ack fits, a done does not
  uint8_t bytes[wire::kFrameMax];
  const uint8_t count = encode(m(74, 1, 0), bytes);
  for (uint8_t i = 0; i < count; ++i) desk.link.receive(bytes[i], desk.now_ms);
  desk.take_frames();
  desk.run_ms(500);
  EXPECT_EQ(count_of(desk.take_frames(), Type::kDone), 1);
}

// Duplicated, delayed and damaged orders never extrude what was not asked for, and both sides agree
// at the end.
TEST(Link, FaultsOfTheWireNeverExecuteAnOrderTwice) {
  for (uint32_t seed = 0; seed < 200; ++seed) {
    std::mt19937 engine(seed);
    const auto random = [&engine] { return static_cast<uint32_t>(engine()); };
    Desk desk;
    desk.greet();
    desk.open_hot();
    uint8_t sequence = 0;
    std::vector<Frame> sent;
    int32_t expected = 0;
    for (int cycle = 0; cycle < 20; ++cycle) {
      for (const auto& [code, argument, steps] : {std::tuple{74, 1000, -420}, std::tuple{75, 0, 0},
                                                  std::tuple{72, 350, 420}, std::tuple{73, 0, 0}}) {
        const Frame frame = m(static_cast<uint8_t>(code), ++sequence, argument);
        sent.push_back(frame);
        bool done = false;
        for (int attempt = 0; !done && attempt < 200; ++attempt) {
          uint8_t bytes[wire::kFrameMax];
          const uint8_t count = encode(frame, bytes);
          for (uint8_t i = 0; i < count; ++i) {
            const uint32_t luck = random() % 100;
            if (luck == 0) continue;  // lost
            desk.link.receive(luck == 1 ? static_cast<uint8_t>(random()) : bytes[i], desk.now_ms);
          }
          if (random() % 4 == 0) desk.send(sent[random() % sent.size()]);  // an old one again
          desk.run_ms(60);
          for (const Frame& answer : desk.take_frames()) {
            done |= answer.type == Type::kDone && answer.sequence == sequence;
          }
        }
        ASSERT_TRUE(done) << "seed " << seed;
        expected += steps;
        if (code == 74) {
          ASSERT_EQ(desk.extruder.retracted(), 420) << "seed " << seed;
        }
        if (code == 72) {
          ASSERT_EQ(desk.extruder.state(), State::kExtruding) << "seed " << seed;
        }
        if (code == 73) {
          ASSERT_EQ(desk.extruder.state(), State::kReady) << "seed " << seed;
          expected = desk.extruder.position();
        }
        ASSERT_EQ(desk.extruder.position(), desk.timer.position());
      }
    }
    ASSERT_EQ(desk.extruder.position(), expected);
  }
}

TEST(Terminal, LinesAreOrdersAndOkComesAtTheirEnd) {
  Desk desk;
  desk.silent = true;
  desk.hot_end.set_temperature(205);
  desk.run_ms(200);
  desk.send_text("M70 S205\n");
  EXPECT_EQ(desk.take_text(), "");
  desk.run_ms(10'000);  // longer than a host may be silent
  EXPECT_EQ(desk.take_text(), "ok\n");
  desk.send_text("m72 l5 f10\r\n");
  EXPECT_EQ(desk.take_text(), "");
  desk.run_ms(1000);
  EXPECT_EQ(desk.take_text(), "ok\n");
  EXPECT_EQ(desk.extruder.position(), 2100);
  desk.send_text("?\n");
  EXPECT_EQ(desk.take_text(), "state=2 fault=0 temp=205 steps=2100\n");
  desk.send_text("M74 L1.5\nM75\n");
  desk.run_ms(1000);
  EXPECT_EQ(desk.extruder.retracted(), 630);  // M75 found M74 under way
  EXPECT_EQ(desk.take_text(), "error 4\nok\n");
}

TEST(Terminal, ExtrusionNeedsALength) {
  Desk desk;
  desk.silent = true;
  desk.hot_end.set_temperature(205);
  desk.run_ms(200);
  desk.send_text("M70\n");
  desk.run_ms(4000);
  desk.take_text();
  for (const char* line : {"M72\n", "M72 F5\n", "M72 L\n", "M72 Lx\n", "M72 L0\n"}) {
    desk.send_text(line);
    EXPECT_EQ(desk.take_text(), "error 6\n") << line;
  }
}

TEST(Terminal, NonsenseIsAnError) {
  Desk desk;
  for (const char* line : {"M7\n", "M76\n", "M701\n", "G0\n", "hello\n",
                           "M70 S200 and a line that is far too long for anybody\n"}) {
    desk.send_text(line);
    EXPECT_EQ(desk.take_text(), "error 5\n") << line;
  }
  desk.send_text("\n\r\n");
  EXPECT_EQ(desk.take_text(), "");
  desk.send_text("M72 L1\n");
  EXPECT_EQ(desk.take_text(), "error 7\n");
}

TEST(Terminal, AStopSupersedesAndAFaultIsCleared) {
  Desk desk;
  desk.silent = true;
  desk.hot_end.set_temperature(100);
  desk.run_ms(200);
  desk.send_text("M70\n");
  desk.run_ms(10);
  desk.send_text("CLEAR\n");
  EXPECT_EQ(desk.take_text(), "error 4\n");
  desk.send_text("M71\n");
  EXPECT_EQ(desk.take_text(), "error 15\n");
  desk.run_ms(2000);
  EXPECT_EQ(desk.take_text(), "ok\n");
  desk.extruder.fault(wire::Fault::kInternal);
  desk.send_text("M70\n");
  EXPECT_EQ(desk.take_text(), "error 1\n");
  desk.send_text("clear\n");
  EXPECT_EQ(desk.take_text(), "ok\n");
  desk.extruder.fault(wire::Fault::kInternal);
  desk.hot_end.set_sensor(SensorWiring::kOpen);
  desk.run_ms(200);
  desk.take_frames();
  desk.send_text("?\n");
  EXPECT_EQ(desk.take_text(), "state=9 fault=11 temp=? steps=0\n");
}

TEST(Terminal, IsDeafWhileAHostIsAlive) {
  Desk desk;
  desk.greet();
  desk.send_text("M70\n");
  EXPECT_EQ(desk.take_text(), "");
  EXPECT_EQ(desk.extruder.state(), State::kClosed);
  desk.run_ms(4000);
  desk.send_text("M71\n");
  desk.run_ms(2000);
  EXPECT_EQ(desk.take_text(), "ok\n");
}

TEST(Terminal, InStreamTakesStopsOnly) {
  Desk desk;
  desk.settings.set(Setting::kInStream, 1);
  desk.send_text("M70\n");
  EXPECT_EQ(desk.take_text(), "error 19\n");
  desk.send_text("M73\n");
  desk.run_ms(2);
  EXPECT_EQ(desk.take_text(), "ok\n");
}

TEST(Store, SettingsSurviveAReset) {
  Desk::eeprom.fill(0xFF);
  {
    Desk desk;
    desk.greet();
    desk.send(pack(wire::SetSetting{Setting::kRetractLength, 777}, 1));
    desk.send(wire::pack(Type::kSaveSettings, 2));
    EXPECT_EQ(refusal(desk, pack(wire::SetSetting{Setting::kRetractLength, 1}, 3)), Reason::kBusy);
    EXPECT_EQ(refusal(desk, m(73, 4)), Reason::kBusy);
    desk.run_ms(200);
    EXPECT_EQ(only<wire::Done>(desk.take_frames(), Type::kDone, 2).reason, Reason::kNone);
  }
  Desk desk;
  desk.store.load(desk.settings);
  EXPECT_EQ(desk.settings.get(Setting::kRetractLength), 777);
}

TEST(Store, AnEmptyMemoryGivesPresets) {
  Desk::eeprom.fill(0xFF);
  Desk desk;
  desk.settings.set(Setting::kRetractLength, 1);
  desk.store.load(desk.settings);
  EXPECT_EQ(desk.settings.get(Setting::kRetractLength), 1000);
}

TEST(Store, ATornWriteFallsBackToTheOlderCopy) {
  // A third value is being written over the copy with the first when the supply fails after n
  // bytes.
  for (int torn = 0; torn <= 107; ++torn) {
    Desk::eeprom.fill(0xFF);
    Desk desk;
    for (const int value : {1001, 1002, 1003}) {
      desk.settings.set(Setting::kRetractLength, value);
      desk.store.begin_save(desk.settings);
      for (int n = 0; value < 1003 || n < torn; ++n) {
        if (desk.store.advance() != Store::Progress::kWriting) break;
      }
    }
    Desk after;
    after.store.load(after.settings);
    ASSERT_EQ(after.settings.get(Setting::kRetractLength), 1002) << torn;
  }
}

TEST(Store, GenerationsWrap) {
  Desk::eeprom.fill(0xFF);
  for (int value = 0; value < 600; ++value) {
    Desk desk;
    desk.store.load(desk.settings);
    desk.settings.set(Setting::kRetractLength, value);
    desk.store.begin_save(desk.settings);
    while (desk.store.advance() == Store::Progress::kWriting) {
    }
    Desk after;
    after.store.load(after.settings);
    ASSERT_EQ(after.settings.get(Setting::kRetractLength), value);
  }
}

TEST(Store, AMemoryThatDoesNotKeepIsReported) {
  Desk::eeprom.fill(0xFF);
  Settings settings;
  Store store({[](uint16_t address) { return Desk::eeprom[address]; }, [] { return true; },
               [](uint16_t, uint8_t) {}});
  store.begin_save(settings);
  Store::Progress progress;
  while ((progress = store.advance()) == Store::Progress::kWriting) {
  }
  EXPECT_EQ(progress, Store::Progress::kFailed);
  EXPECT_EQ(store.advance(), Store::Progress::kIdle);
}

TEST(Store, ASaveBegunAnewKeepsTheWholeCopy) {
  Desk::eeprom.fill(0xFF);
  Desk desk;
  desk.settings.set(Setting::kRetractLength, 5);
  desk.store.begin_save(desk.settings);
  while (desk.store.advance() == Store::Progress::kWriting) {
  }
  desk.settings.set(Setting::kRetractLength, 6);
  desk.store.begin_save(desk.settings);
  for (int n = 0; n < 50; ++n) desk.store.advance();
  desk.store.begin_save(desk.settings);
  for (int n = 0; n < 50; ++n) desk.store.advance();
  Desk after;
  after.store.load(after.settings);
  EXPECT_EQ(after.settings.get(Setting::kRetractLength), 5);
}

TEST(Link, ANewSessionEndsTheExtrusionOfTheOneBefore) {
  Desk desk;
  desk.open_hot();
  desk.greet();
  desk.send(pack(wire::Command{72, 1000}, 1));
  desk.run_ms(100);
  desk.send(pack(wire::Hello{wire::kProtocolVersion, 7}, 0));  // the same session: nothing changes
  desk.run_ms(100);
  EXPECT_EQ(desk.extruder.state(), State::kExtruding);
  desk.send(pack(wire::Hello{wire::kProtocolVersion, 8}, 0));
  desk.run_ms(100);
  EXPECT_EQ(desk.extruder.state(), State::kReady);
  for (const wire::Frame& frame : desk.take_frames()) EXPECT_NE(frame.sequence, 2);
}

TEST(Link, OnlyALineThatIsUnderstoodIsASignOfLife) {
  Desk desk;
  desk.silent = true;
  desk.run_ms(10);
  for (const char* junk : {"G28\n", "M79\n", "?x\n", "CLEARS\n", "\x01\x0a"}) {
    desk.send_text(junk);
    desk.run_ms(5);
    EXPECT_FALSE(desk.extruder.run_permitted()) << junk;
  }
  desk.send_text("?\n");
  desk.run_ms(5);
  EXPECT_TRUE(desk.extruder.run_permitted());
}

}  // namespace
}  // namespace reforge::firmware
