#include "tools/rig/rig_script.h"

#include <gtest/gtest.h>

#include "tools/rig/faulty_wire.h"

namespace reforge {
namespace {

using Kind = RigAction::Kind;

TEST(FaultyWire, PassesEverythingAtOnceByItself) {
  FaultyWire wire(1);
  wire.send("hello", 5);
  EXPECT_EQ(wire.take(5), "hello");
  EXPECT_EQ(wire.faults(), 0);
}

TEST(FaultyWire, SpoilsTheNextBytesAsOrdered) {
  FaultyWire wire(1);
  wire.drop(2);
  wire.send("abcd", 0);
  EXPECT_EQ(wire.take(0), "cd");
  wire.duplicate(1);
  wire.send("ab", 0);
  EXPECT_EQ(wire.take(0), "aab");
  wire.flip(1);
  wire.send("ab", 0);
  const std::string flipped = wire.take(0);
  ASSERT_EQ(flipped.size(), 2u);
  const auto difference = static_cast<unsigned char>(flipped[0] ^ 'a');
  EXPECT_EQ(difference & (difference - 1), 0);
  EXPECT_NE(difference, 0);
  EXPECT_EQ(flipped[1], 'b');
  EXPECT_EQ(wire.faults(), 4);
}

TEST(FaultyWire, DelaysAndStallsKeepTheOrder) {
  FaultyWire wire(1);
  wire.delay(10);
  wire.send("a", 0);
  wire.delay(0);
  wire.send("b", 1);
  EXPECT_EQ(wire.take(9), "");
  EXPECT_EQ(wire.take(10), "ab");
  wire.stall(100);
  wire.send("c", 20);
  EXPECT_EQ(wire.take(99), "");
  EXPECT_EQ(wire.take(100), "c");
}

TEST(FaultyWire, TheSameSeedGivesTheSameNoise) {
  const auto run = [](uint64_t seed) {
    FaultyWire wire(seed);
    wire.set_noise({0.1, 0.1, 0.1, 0});
    wire.send(std::string(1000, 'x'), 0);
    return wire.take(0);
  };
  EXPECT_EQ(run(7), run(7));
  EXPECT_NE(run(7), run(8));
  EXPECT_NE(run(7), std::string(1000, 'x'));
}

TEST(RigScript, EntriesAreDueAtTheirTimesAndOnce) {
  auto script = RigScript::parse(
      "seed 42   # a comment\n"
      "at 1.5 board brown-out\n"
      "on extrude_on 2 +0.05 cnc to-host drop 3\n"
      "at 2 extruder both noise drop=0.01 flip=1e-3 delay=0.02\n",
      "s");
  ASSERT_TRUE(script) << script.error().sentence;
  EXPECT_EQ(script->seed(), 42u);
  EXPECT_TRUE(script->take_due(1'499'999'999).empty());
  auto due = script->take_due(1'500'000'000);
  ASSERT_EQ(due.size(), 1u);
  EXPECT_EQ(due[0].mishap, BoardMishap::kBrownOut);
  script->note("extrude_on", 1'600'000'000);
  script->note("extrude_off", 1'600'000'000);
  script->note("extrude_on", 1'700'000'000);
  script->note("extrude_on", 1'800'000'000);
  EXPECT_TRUE(script->take_due(1'749'999'999).empty());
  due = script->take_due(1'750'000'000);
  ASSERT_EQ(due.size(), 1u);
  EXPECT_EQ(due[0].kind, Kind::kDrop);
  EXPECT_FALSE(due[0].to_device);
  EXPECT_EQ(due[0].amount, 3);
  due = script->take_due(9'000'000'000);
  ASSERT_EQ(due.size(), 1u);
  EXPECT_EQ(due[0].noise.flip, 1e-3);
  EXPECT_EQ(due[0].noise.delay_ns, 20'000'000);
  EXPECT_FALSE(script->waiting());
}

TEST(RigScript, WhatItDoesNotUnderstandNamesTheLine) {
  for (const char* bad :
       {"at x board reset", "at 1 board melt", "at 1 cnc sideways drop 1", "at 1 cnc both drop",
        "on extrude_on 0 board reset", "at 1 cnc both noise drop=2", "soon board reset",
        "at 1 panel dance", "at 1 swap-ports", "at 1 cnc unplug soon"}) {
    const auto script = RigScript::parse(std::string("\n") + bad + "\n", "file");
    ASSERT_FALSE(script) << bad;
    EXPECT_NE(script.error().sentence.find("file, line 2"), std::string::npos) << bad;
  }
}

}  // namespace
}  // namespace reforge
