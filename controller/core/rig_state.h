// The rig's logic as one table: state x event -> next state and effects, or a refusal.
//
// Pure and total: every pair has its entry, checked when compiled. step() performs nothing; the
// sequencer carries out the effects in the order given. A refusal is a sentence for the operator:
// why not, and what to do instead. An event that means nothing in a state (an answer that arrives
// after its question was dropped) keeps the state and has no effects.
//
// Limits: one job at a time; retract and spindle rules at a hold, and run-from-block, are later
// work.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>

namespace reforge {

enum class RigState : std::uint8_t {
  kDisconnected,  // a link is closed
  kIdentifying,   // both open; asking the devices who they are
  kSuspended,     // the CNC holds work that nobody streams any more; only clear (a reset) leads out
  kIdle,          // ready for a job
  kStarting,      // checks before the first line
  kRunning,       // lines flow
  kDraining,      // an M-code or the end is next: waiting until all motion has really finished
  kBarrier,       // drained; the extruder works on the M-code
  kHolding,       // hold sent, motion comes to rest
  kHeld,          // at rest, the CNC keeps its queue
  kResuming,      // extrusion is restored before motion
  kStopping,      // the job is over: coming to rest before the reset
  kResetting,     // reset sent, waiting for the banner
  kFault,         // a device has latched a fault; the operator clears it
};
constexpr int kRigStateCount = 14;

enum class RigEvent : std::uint8_t {
  // Links and identity.
  kLinksOpen,     // both links are open
  kIdentified,    // both devices are who they should be and well
  kFoundHolding,  // identity pending: the CNC is in hold, or moves
  kFoundFault,    // a device has a latched fault, or is not the one in the rig file
  kCncLost,       // hang-up or silence
  kExtruderLost,  // hang-up, silence, or an order nobody acknowledges
  // The operator.
  kStart,
  kHold,
  kResume,
  kAbort,
  kEmergency,
  kClear,
  kShutdown,  // the daemon ends
  kReheat,    // keep the nozzle hot, or no longer, without a job
  // The job's progress.
  kChecksPassed,
  kChecksFailed,
  kBarrierReached,  // the next line is an M-code, or the program is at its end
  kCheckpointed,    // drained at a checkpoint: the stream goes on
  kDrained,         // all acknowledged, dwell acknowledged, Idle: an M-code is to be relayed
  kBarrierDone,     // the extruder has done it
  kFinished,        // drained behind the last line
  kAtRest,          // the CNC reports Hold:0 or Idle
  kRestored,        // extrusion is as it was before the hold (or was off)
  kResetDone,       // banner after our reset
  kRestOverdue,     // no rest, or no banner, in time
  // Faults.
  kCncError,       // error:N
  kCncAlarm,       // ALARM:N, or the state Alarm
  kCncReset,       // a banner nobody asked for
  kAckOverdue,     // Idle, yet lines stay unacknowledged; or more acknowledgements than lines
  kExtruderFault,  // a fault, a refused order, an order without end, a reset of the board
  kInterlock,      // depositing, and the CNC does not run
  kProgramFault,   // the program cannot be read, or asks for what is forbidden
};
constexpr int kRigEventCount = 32;

// What the sequencer does on a transition. What stops extrusion always stands before the CNC's.
enum class Effect : std::uint8_t {
  kIdentify,        // start, or start again, asking both devices
  kCheckStart,      // ask for G54, compare, ask for the first horizon
  kRelay,           // give the extruder its M-code
  kPauseExtrusion,  // M73, urgent, if filament is or may be pushed; remembers the bead
  kStopExtrusion,   // M73, urgent, whatever is known
  kStarve,          // stop feeding the extruder's dead-man: heat off, nothing moves
  kMakeSafe,        // close the module where that is clear of the part, otherwise kStarve
  kHoldCnc,         // '!', urgent
  kResumeCnc,       // '~'
  kDropUnsent,      // discard unsent bytes for the CNC
  kResetCnc,        // 0x18, urgent
  kReopenCnc,       // close and open the port
  kReopenExtruder,  // likewise; its first order will be M73
  kOweHold,         // the first byte after the next opening of the CNC's port is a hold
  kReheat,          // M70 without a job, or the end of it
  kRestore,         // M72 again if a bead was interrupted
  kClearFaults,     // clear the extruder's fault; reset a held CNC, unlock an alarm
  kJobRefused,      // journal and tell: nothing was sent, the job is ready as before
  kJobRunning,      // journal and tell: the job runs
  kJobHeld,
  kJobOver,  // journal and tell the verdict
};

constexpr int kEffectsMax = 7;

struct Step {
  RigState next;
  std::span<const Effect> effects;
  std::string_view refusal;  // empty: accepted
  bool refused() const { return !refusal.empty(); }
};

Step step(RigState state, RigEvent event);

std::string_view name(RigState state);  // "disconnected", "identifying", ...
std::string_view name(RigEvent event);

// Is a job between its start and its verdict?
constexpr bool has_job(RigState state) {
  return state >= RigState::kStarting && state <= RigState::kResetting;
}

}  // namespace reforge
