#include "controller/core/rig_state.h"

#include <initializer_list>
#include <iterator>

namespace reforge {

namespace {

using S = RigState;
using E = RigEvent;
using F = Effect;

struct Cell {
  bool written = false;
  S next{};
  std::array<F, kEffectsMax> effects{};
  std::uint8_t count = 0;
  std::string_view refusal{};
};

struct Table {
  std::array<std::array<Cell, kRigEventCount>, kRigStateCount> cells{};
  bool doubly_written = false;

  constexpr void write(S state, E event, Cell cell) {
    Cell& place = cells[static_cast<std::size_t>(state)][static_cast<std::size_t>(event)];
    doubly_written = doubly_written || place.written;
    cell.written = true;
    place = cell;
  }
  template <typename... Effects>
  constexpr void go(std::initializer_list<S> from, E event, S next, Effects... effects) {
    static_assert(sizeof...(effects) <= kEffectsMax);
    for (const S state : from) {
      write(state, event, Cell{true, next, {effects...}, sizeof...(effects), {}});
    }
  }
  constexpr void refuse(std::initializer_list<S> from, E event, std::string_view why) {
    for (const S state : from) write(state, event, Cell{true, state, {}, 0, why});
  }
  // Means nothing here: the state stays, nothing is done.
  constexpr void ignore(std::initializer_list<S> from, E event) {
    for (const S state : from) write(state, event, Cell{true, state, {}, 0, {}});
  }
  // Everything not written so far.
  constexpr void ignore_elsewhere(E event) {
    for (int s = 0; s < kRigStateCount; ++s) {
      Cell& cell = cells[static_cast<std::size_t>(s)][static_cast<std::size_t>(event)];
      if (!cell.written) cell = Cell{true, static_cast<S>(s), {}, 0, {}};
    }
  }
};

constexpr std::string_view kNotConnected =
    "The rig is not connected: check both ports; for an emergency use the machine's E-stop.";
constexpr std::string_view kStillIdentifying =
    "The devices are still being identified: wait until the rig is idle.";
constexpr std::string_view kClearFirst = "A device has a fault: look at the rig, then clear it.";
constexpr std::string_view kSuspendedFirst =
    "The CNC holds work of an interrupted job: look at the rig, then clear it (the CNC is reset).";
constexpr std::string_view kNoJob = "No job is running.";
constexpr std::string_view kJobRuns = "A job has the rig: wait for its end, or abort it first.";
constexpr std::string_view kEnding =
    "The job is already being stopped: wait until the rig is idle.";

// The states in which lines have been sent and the job may still go on.
constexpr std::initializer_list<S> kJobStates = {S::kRunning, S::kDraining, S::kBarrier,
                                                 S::kHolding, S::kHeld,     S::kResuming};

constexpr void links(Table& t) {
  t.go({S::kDisconnected}, E::kLinksOpen, S::kIdentifying, F::kIdentify);
  t.ignore_elsewhere(E::kLinksOpen);

  t.go({S::kIdentifying}, E::kIdentified, S::kIdle);
  t.ignore_elsewhere(E::kIdentified);

  // In mid-job somebody held at the panel, or the hold input dropped: make it a hold of ours.
  t.go({S::kIdentifying, S::kIdle}, E::kFoundHolding, S::kSuspended);
  t.go({S::kRunning, S::kDraining, S::kBarrier}, E::kFoundHolding, S::kHolding, F::kPauseExtrusion,
       F::kHoldCnc);
  t.ignore_elsewhere(E::kFoundHolding);

  t.go({S::kIdentifying, S::kIdle}, E::kFoundFault, S::kFault);
  t.ignore_elsewhere(E::kFoundFault);

  t.go({S::kDisconnected, S::kIdentifying, S::kIdle}, E::kCncLost, S::kDisconnected, F::kReopenCnc);
  t.go({S::kSuspended, S::kFault}, E::kCncLost, S::kDisconnected, F::kOweHold, F::kReopenCnc);
  t.go({S::kStarting}, E::kCncLost, S::kDisconnected, F::kReopenCnc, F::kJobRefused);
  t.go(kJobStates, E::kCncLost, S::kDisconnected, F::kStopExtrusion, F::kStarve, F::kDropUnsent,
       F::kHoldCnc, F::kOweHold, F::kReopenCnc, F::kJobOver);
  t.go({S::kStopping, S::kResetting}, E::kCncLost, S::kDisconnected, F::kStopExtrusion, F::kStarve,
       F::kDropUnsent, F::kHoldCnc, F::kOweHold, F::kReopenCnc, F::kJobOver);

  t.go({S::kDisconnected, S::kIdentifying, S::kIdle, S::kSuspended, S::kFault}, E::kExtruderLost,
       S::kDisconnected, F::kReopenExtruder);
  t.go({S::kStarting}, E::kExtruderLost, S::kDisconnected, F::kReopenExtruder, F::kJobRefused);
  t.go(kJobStates, E::kExtruderLost, S::kStopping, F::kStopExtrusion, F::kDropUnsent, F::kHoldCnc,
       F::kReopenExtruder);
  t.go({S::kStopping}, E::kExtruderLost, S::kStopping, F::kReopenExtruder);
  t.go({S::kResetting}, E::kExtruderLost, S::kResetting, F::kReopenExtruder);
}

constexpr void operator_orders(Table& t) {
  t.go({S::kIdle}, E::kStart, S::kStarting, F::kCheckStart);
  t.refuse({S::kDisconnected}, E::kStart, kNotConnected);
  t.refuse({S::kIdentifying}, E::kStart, kStillIdentifying);
  t.refuse({S::kSuspended}, E::kStart, kSuspendedFirst);
  t.refuse({S::kFault}, E::kStart, kClearFirst);
  t.refuse({S::kStarting, S::kRunning, S::kDraining, S::kBarrier, S::kHolding, S::kHeld,
            S::kResuming, S::kStopping, S::kResetting},
           E::kStart, kJobRuns);

  t.go({S::kRunning, S::kDraining, S::kBarrier, S::kResuming}, E::kHold, S::kHolding,
       F::kPauseExtrusion, F::kHoldCnc);
  t.go({S::kHolding}, E::kHold, S::kHolding, F::kHoldCnc);
  t.ignore({S::kHeld}, E::kHold);
  t.go({S::kStarting}, E::kHold, S::kIdle, F::kJobRefused);
  t.refuse({S::kDisconnected}, E::kHold, kNotConnected);
  t.refuse({S::kIdentifying, S::kIdle, S::kFault}, E::kHold, kNoJob);
  t.refuse({S::kSuspended}, E::kHold, "The CNC is in hold already and no job is running.");
  t.refuse({S::kStopping, S::kResetting}, E::kHold, kEnding);

  t.go({S::kHeld}, E::kResume, S::kResuming, F::kRestore);
  t.refuse({S::kHolding}, E::kResume,
           "The CNC is still coming to rest: resume when the rig is held.");
  t.refuse({S::kStarting, S::kRunning, S::kDraining, S::kBarrier, S::kResuming}, E::kResume,
           "The job is not held.");
  t.refuse({S::kDisconnected}, E::kResume, kNotConnected);
  t.refuse({S::kIdentifying, S::kIdle}, E::kResume, kNoJob);
  t.refuse({S::kSuspended}, E::kResume,
           "An interrupted job cannot be resumed from where the CNC stands: look at the rig, then "
           "clear it.");
  t.refuse({S::kFault}, E::kResume, kClearFirst);
  t.refuse({S::kStopping, S::kResetting}, E::kResume, kEnding);

  t.go({S::kStarting}, E::kAbort, S::kIdle, F::kJobOver);
  t.go(kJobStates, E::kAbort, S::kStopping, F::kStopExtrusion, F::kDropUnsent, F::kHoldCnc);
  t.refuse({S::kDisconnected}, E::kAbort, kNotConnected);
  t.refuse({S::kIdentifying, S::kIdle}, E::kAbort, kNoJob);
  t.refuse({S::kSuspended}, E::kAbort, kSuspendedFirst);
  t.refuse({S::kFault}, E::kAbort, kClearFirst);
  t.refuse({S::kStopping, S::kResetting}, E::kAbort, kEnding);

  t.go({S::kDisconnected}, E::kEmergency, S::kDisconnected, F::kStopExtrusion, F::kStarve,
       F::kDropUnsent, F::kResetCnc);
  t.go({S::kIdentifying, S::kSuspended, S::kIdle, S::kFault}, E::kEmergency, S::kFault,
       F::kStopExtrusion, F::kStarve, F::kDropUnsent, F::kResetCnc);
  t.go({S::kStarting, S::kRunning, S::kDraining, S::kBarrier, S::kHolding, S::kHeld, S::kResuming,
        S::kStopping, S::kResetting},
       E::kEmergency, S::kFault, F::kStopExtrusion, F::kStarve, F::kDropUnsent, F::kResetCnc,
       F::kJobOver);

  t.go({S::kIdentifying, S::kSuspended, S::kIdle, S::kFault}, E::kClear, S::kIdentifying,
       F::kClearFaults);
  t.refuse({S::kDisconnected}, E::kClear, kNotConnected);
  t.refuse({S::kStarting, S::kRunning, S::kDraining, S::kBarrier, S::kHolding, S::kHeld,
            S::kResuming, S::kStopping, S::kResetting},
           E::kClear, kJobRuns);

  t.go({S::kStarting}, E::kShutdown, S::kIdle, F::kJobRefused);
  t.go(kJobStates, E::kShutdown, S::kSuspended, F::kStopExtrusion, F::kHoldCnc, F::kJobOver);
  t.ignore_elsewhere(E::kShutdown);

  t.go({S::kIdle}, E::kReheat, S::kIdle, F::kReheat);
  t.refuse({S::kDisconnected}, E::kReheat, kNotConnected);
  t.refuse({S::kIdentifying}, E::kReheat, kStillIdentifying);
  t.refuse({S::kSuspended}, E::kReheat, kSuspendedFirst);
  t.refuse({S::kFault}, E::kReheat, kClearFirst);
  t.refuse({S::kStarting, S::kRunning, S::kDraining, S::kBarrier, S::kHolding, S::kHeld,
            S::kResuming, S::kStopping, S::kResetting},
           E::kReheat, kJobRuns);
}

constexpr void progress(Table& t) {
  t.go({S::kStarting}, E::kChecksPassed, S::kRunning, F::kJobRunning);
  t.ignore_elsewhere(E::kChecksPassed);
  t.go({S::kStarting}, E::kChecksFailed, S::kIdle, F::kJobRefused);
  t.ignore_elsewhere(E::kChecksFailed);

  t.go({S::kRunning}, E::kBarrierReached, S::kDraining);
  t.ignore_elsewhere(E::kBarrierReached);
  t.go({S::kDraining}, E::kDrained, S::kBarrier, F::kRelay);
  t.ignore_elsewhere(E::kDrained);
  t.go({S::kDraining}, E::kCheckpointed, S::kRunning);
  t.ignore_elsewhere(E::kCheckpointed);
  t.go({S::kBarrier}, E::kBarrierDone, S::kRunning);
  t.ignore_elsewhere(E::kBarrierDone);
  t.go({S::kDraining}, E::kFinished, S::kIdle, F::kMakeSafe, F::kJobOver);
  t.ignore_elsewhere(E::kFinished);

  t.go({S::kHolding}, E::kAtRest, S::kHeld, F::kJobHeld);
  t.go({S::kStopping}, E::kAtRest, S::kResetting, F::kResetCnc);
  t.ignore_elsewhere(E::kAtRest);
  t.go({S::kResuming}, E::kRestored, S::kRunning, F::kResumeCnc, F::kJobRunning);
  t.ignore_elsewhere(E::kRestored);
  // Both devices are asked again who they are and how they are before the rig is idle.
  t.go({S::kResetting}, E::kResetDone, S::kDisconnected, F::kMakeSafe, F::kJobOver);
  t.ignore_elsewhere(E::kResetDone);

  t.go({S::kHolding, S::kStopping}, E::kRestOverdue, S::kResetting, F::kStopExtrusion,
       F::kDropUnsent, F::kResetCnc);
  t.go({S::kResetting}, E::kRestOverdue, S::kDisconnected, F::kStopExtrusion, F::kStarve,
       F::kOweHold, F::kReopenCnc, F::kJobOver);
  t.ignore_elsewhere(E::kRestOverdue);
}

// An error does not flush what the receiver holds: hold, come to rest, then reset.
constexpr void stop_in_order(Table& t, E event) {
  t.go(kJobStates, event, S::kStopping, F::kStopExtrusion, F::kDropUnsent, F::kHoldCnc);
}

constexpr void faults(Table& t) {
  stop_in_order(t, E::kCncError);
  t.ignore_elsewhere(E::kCncError);
  stop_in_order(t, E::kAckOverdue);
  t.ignore_elsewhere(E::kAckOverdue);
  stop_in_order(t, E::kProgramFault);
  t.go({S::kStarting}, E::kProgramFault, S::kIdle, F::kJobRefused);
  t.ignore_elsewhere(E::kProgramFault);
  stop_in_order(t, E::kExtruderFault);
  t.go({S::kStarting}, E::kExtruderFault, S::kFault, F::kJobRefused);
  t.go({S::kIdentifying, S::kIdle}, E::kExtruderFault, S::kFault);
  t.ignore_elsewhere(E::kExtruderFault);

  // An alarm has stopped the motion; the reset empties the receiver before anybody unlocks.
  t.go(kJobStates, E::kCncAlarm, S::kResetting, F::kStopExtrusion, F::kDropUnsent, F::kResetCnc);
  t.go({S::kStopping}, E::kCncAlarm, S::kResetting, F::kResetCnc);
  t.go({S::kStarting}, E::kCncAlarm, S::kFault, F::kJobRefused);
  t.go({S::kIdentifying, S::kSuspended, S::kIdle}, E::kCncAlarm, S::kFault);
  t.ignore_elsewhere(E::kCncAlarm);

  // What was sent after the controller's own reset must not run: reset once more.
  t.go(kJobStates, E::kCncReset, S::kFault, F::kStopExtrusion, F::kStarve, F::kDropUnsent,
       F::kResetCnc, F::kJobOver);
  t.go({S::kStopping}, E::kCncReset, S::kFault, F::kStopExtrusion, F::kStarve, F::kDropUnsent,
       F::kResetCnc, F::kJobOver);
  t.go({S::kStarting}, E::kCncReset, S::kIdentifying, F::kJobRefused, F::kIdentify);
  t.go({S::kIdentifying, S::kSuspended, S::kIdle}, E::kCncReset, S::kIdentifying, F::kIdentify);
  t.ignore_elsewhere(E::kCncReset);

  t.go({S::kRunning, S::kDraining, S::kHeld}, E::kInterlock, S::kHolding, F::kPauseExtrusion,
       F::kHoldCnc);
  t.ignore_elsewhere(E::kInterlock);
}

constexpr Table make_table() {
  Table t;
  links(t);
  operator_orders(t);
  progress(t);
  faults(t);
  return t;
}

constexpr Table kTable = make_table();

constexpr bool total(const Table& t) {
  for (const auto& row : t.cells) {
    for (const Cell& cell : row) {
      if (!cell.written) return false;
    }
  }
  return !t.doubly_written;
}
static_assert(total(kTable), "every state has exactly one answer to every event");

// An extruder that may push is told to stop before the CNC is told anything.
constexpr bool extrusion_stops_first(const Table& t) {
  for (const auto& row : t.cells) {
    for (const Cell& cell : row) {
      bool cnc = false;
      for (int i = 0; i < cell.count; ++i) {
        const F effect = cell.effects[static_cast<std::size_t>(i)];
        cnc = cnc || effect == F::kHoldCnc || effect == F::kResetCnc || effect == F::kDropUnsent;
        if (cnc && (effect == F::kStopExtrusion || effect == F::kPauseExtrusion)) return false;
      }
    }
  }
  return true;
}
static_assert(extrusion_stops_first(kTable));

constexpr std::string_view kStateNames[] = {
    "disconnected", "identifying", "suspended", "idle",     "starting", "running",   "draining",
    "barrier",      "holding",     "held",      "resuming", "stopping", "resetting", "fault"};
static_assert(std::size(kStateNames) == kRigStateCount);
static_assert(static_cast<int>(S::kFault) + 1 == kRigStateCount);

constexpr std::string_view kEventNames[] = {
    "links open",    "identified",      "found holding", "found fault", "CNC lost",
    "extruder lost", "start",           "hold",          "resume",      "abort",
    "emergency",     "clear",           "shutdown",      "reheat",      "checks passed",
    "checks failed", "barrier reached", "checkpointed",  "drained",     "barrier done",
    "finished",      "at rest",         "restored",      "reset done",  "rest overdue",
    "CNC error",     "CNC alarm",       "CNC reset",     "ack overdue", "extruder fault",
    "interlock",     "program fault"};
static_assert(std::size(kEventNames) == kRigEventCount);
static_assert(static_cast<int>(E::kProgramFault) + 1 == kRigEventCount);

}  // namespace

Step step(RigState state, RigEvent event) {
  const Cell& cell = kTable.cells[static_cast<std::size_t>(state)][static_cast<std::size_t>(event)];
  return {cell.next, {cell.effects.data(), cell.count}, cell.refusal};
}

std::string_view name(RigState state) {
  return kStateNames[static_cast<std::size_t>(state)];
}

std::string_view name(RigEvent event) {
  return kEventNames[static_cast<std::size_t>(event)];
}

}  // namespace reforge
