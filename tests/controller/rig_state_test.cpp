#include "controller/core/rig_state.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace reforge {
namespace {

template <typename Visit>
void for_every_pair(Visit visit) {
  for (int s = 0; s < kRigStateCount; ++s) {
    for (int e = 0; e < kRigEventCount; ++e) {
      visit(static_cast<RigState>(s), static_cast<RigEvent>(e));
    }
  }
}

bool has(const Step& step, Effect effect) {
  return std::find(step.effects.begin(), step.effects.end(), effect) != step.effects.end();
}

bool by_operator(RigEvent event) {
  return event >= RigEvent::kStart && event <= RigEvent::kReheat;
}

TEST(RigState, EveryStateAnswersEveryEvent) {
  for_every_pair([](RigState state, RigEvent event) {
    const Step next = step(state, event);
    EXPECT_LT(static_cast<int>(next.next), kRigStateCount);
    EXPECT_FALSE(name(state).empty());
    EXPECT_FALSE(name(event).empty());
  });
}

TEST(RigState, OnlyTheOperatorIsRefusedAndAlwaysWithASentence) {
  for_every_pair([](RigState state, RigEvent event) {
    const Step next = step(state, event);
    if (!next.refused()) return;
    EXPECT_TRUE(by_operator(event)) << name(state) << " × " << name(event);
    EXPECT_EQ(next.next, state);
    EXPECT_TRUE(next.effects.empty());
    EXPECT_EQ(next.refusal.back(), '.');
    EXPECT_NE(next.refusal.find(' '), std::string_view::npos);
  });
}

TEST(RigState, EmergencyIsNeverRefusedAndResetsBothSides) {
  for (int s = 0; s < kRigStateCount; ++s) {
    const Step next = step(static_cast<RigState>(s), RigEvent::kEmergency);
    EXPECT_FALSE(next.refused());
    EXPECT_TRUE(has(next, Effect::kResetCnc));
    EXPECT_TRUE(has(next, Effect::kStopExtrusion));
    EXPECT_TRUE(has(next, Effect::kStarve));
  }
}

TEST(RigState, AJobEndsExactlyWhereTheRigLeavesIt) {
  for_every_pair([](RigState state, RigEvent event) {
    const Step next = step(state, event);
    const bool over = has(next, Effect::kJobOver) || has(next, Effect::kJobRefused);
    EXPECT_EQ(over, has_job(state) && !has_job(next.next)) << name(state) << " × " << name(event);
    if (has(next, Effect::kJobRefused)) {
      EXPECT_EQ(state, RigState::kStarting);
    }
  });
}

TEST(RigState, EveryAbnormalWayOutOfARunningJobStopsExtrusion) {
  for_every_pair([](RigState state, RigEvent event) {
    const bool active = state >= RigState::kRunning && state <= RigState::kResuming;
    const Step next = step(state, event);
    if (!active || next.refused() || event == RigEvent::kFinished) return;
    const bool leaves = next.next == RigState::kStopping || !has_job(next.next);
    if (leaves) {
      EXPECT_TRUE(has(next, Effect::kStopExtrusion)) << name(state) << " × " << name(event);
    }
    const bool holds = state != RigState::kHolding && next.next == RigState::kHolding;
    if (holds) {
      EXPECT_TRUE(has(next, Effect::kPauseExtrusion)) << name(state) << " × " << name(event);
      EXPECT_TRUE(has(next, Effect::kHoldCnc)) << name(state) << " × " << name(event);
    }
  });
}

TEST(RigState, AResetOfTheCncIsPrecededByAHoldUnlessItIsAnEmergencyOrTheCncHasStoppedItself) {
  for_every_pair([](RigState state, RigEvent event) {
    const Step next = step(state, event);
    if (!has(next, Effect::kResetCnc) || event == RigEvent::kEmergency) return;
    const bool stopped_itself = event == RigEvent::kCncAlarm || event == RigEvent::kCncReset;
    const bool held_before = state == RigState::kStopping || state == RigState::kHolding;
    EXPECT_TRUE(stopped_itself || held_before) << name(state) << " × " << name(event);
  });
}

TEST(RigState, ALostCncIsOwedAHoldWheneverItMayMove) {
  for (int s = 0; s < kRigStateCount; ++s) {
    const auto state = static_cast<RigState>(s);
    const bool may_move = (has_job(state) && state != RigState::kStarting) ||
                          state == RigState::kSuspended || state == RigState::kFault;
    EXPECT_EQ(has(step(state, RigEvent::kCncLost), Effect::kOweHold), may_move) << name(state);
  }
}

TEST(RigState, RefusesStartWhileAJobRuns) {
  EXPECT_TRUE(step(RigState::kRunning, RigEvent::kStart).refused());
  EXPECT_TRUE(step(RigState::kSuspended, RigEvent::kStart).refused());
  EXPECT_FALSE(step(RigState::kIdle, RigEvent::kStart).refused());
}

}  // namespace
}  // namespace reforge
