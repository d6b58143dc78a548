#include "planner/reuse/set_cover.h"

#include <gtest/gtest.h>

namespace reforge {
namespace {

using Chosen = std::vector<std::size_t>;

TEST(SetCover, OneSetForAllBeatsTwoThatCostMore) {
  EXPECT_EQ(cheapest_cover(2, {{{0}, 0.3}, {{1}, 0.3}, {{0, 1}, 0.5}}), Chosen{2});
}

TEST(SetCover, TwoCheapSetsBeatOneDearOne) {
  EXPECT_EQ(cheapest_cover(2, {{{0}, 0.2}, {{1}, 0.2}, {{0, 1}, 0.5}}), (Chosen{0, 1}));
}

TEST(SetCover, GreedyWouldFailHere) {
  // By weight per element {0,1,2,3} looks best, but leaves 4 and 5 to dear sets.
  EXPECT_EQ(
      cheapest_cover(
          6, {{{0, 1, 2, 3}, 0.4}, {{0, 1, 4}, 0.35}, {{2, 3, 5}, 0.35}, {{4}, 0.3}, {{5}, 0.3}}),
      (Chosen{1, 2}));
}

TEST(SetCover, AmongEqualsTheEarliestIsTaken) {
  EXPECT_EQ(cheapest_cover(1, {{{0}, 0.5}, {{0}, 0.5}}), Chosen{0});
}

TEST(SetCover, WhatNoSetHasIsLeftAndTheRestIsCovered) {
  EXPECT_EQ(cheapest_cover(3, {{{0, 2}, 0.1}}), Chosen{0});
  EXPECT_TRUE(cheapest_cover(3, {}).empty());
  EXPECT_TRUE(cheapest_cover(0, {{{}, 0.1}}).empty());
}

}  // namespace
}  // namespace reforge
