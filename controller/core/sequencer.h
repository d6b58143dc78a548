// The controller's heart: runs one job on CNC and extruder and keeps them safe together.
//
// Sans I/O: bytes, time and answers come in by the methods below; what is to be done comes out of
// take_actions() (action.h), to be carried out in order after every call. Call tick() no later than
// next_deadline(). Nothing here reads a clock, a file or a socket; one thread.
//
// Rules kept (the tests check them under seeded faults):
//  - What happens next is rig_state's table; this class turns bytes into its events and its effects
//    into actions.
//  - Every way out of depositing sends M73 before anything goes to the CNC.
//  - Unacknowledged bytes never exceed the receiver; no line passes the durable horizon.
//  - After the CNC's link was lost, or a job was left by a crash, the first byte to the CNC is a
//  hold,
//    and only holds and status queries follow until the operator clears.
//  - An M-code is relayed only when all lines are acknowledged, the dwell behind them is
//  acknowledged
//    and the CNC then says Idle; the next line goes when the extruder says done.
//  - After an abnormal end, heat ends without motion: the module retreats (M71) only when the CNC
//  is
//    known to stand at or above the rig's clear height; otherwise the board's dead-man is left to
//    act (it also drops the CNC's hold input). An emergency always does the latter.
//  - A hold in mid-bead stops extrusion first. Its resume needs the operator's word that the bead
//  was
//    inspected; then M72 is done again before motion goes on.
//
// Limits: retract and spindle rule at a hold, overrides, single block, run-from-block are later
// work.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "controller/core/action.h"
#include "controller/core/deposit_watch.h"
#include "controller/core/streamer.h"
#include "controller/devices/cnc_session.h"
#include "controller/devices/extruder_link.h"

namespace reforge {

struct CoreOptions {
  bool ports_are_virtual = false;      // both ports are simulated or pseudo-terminals by the config
  std::uint16_t extruder_session = 1;  // not 0, not the previous daemon's
  LineNumber horizon_ahead = 200;
  LineNumber checkpoint_every = 500;  // lines (streamer.h)
  CncTimes cnc;
  ExtruderTimes extruder;
  Duration rest = std::chrono::seconds(5);         // hold to Hold:0; reset to banner
  Duration ack_overdue = std::chrono::seconds(2);  // Idle with unacknowledged lines, dwells apart
  Duration deposit_grace = std::chrono::milliseconds(250);
  Duration reheat_max = std::chrono::minutes(30);
  Duration clear_hint =
      std::chrono::seconds(10);  // devices that do not answer are named after this
};

// What the operator asks for. Start carries the job; Resume and Clear carry his word.
struct StartOrder {
  JobOrder job;
};
struct HoldOrder {};
struct ResumeOrder {
  bool bead_inspected = false;
};
struct AbortOrder {};
struct EmergencyOrder {};  // no substitute for an E-stop
struct ClearOrder {
  bool module_may_retreat = false;
};                        // he has looked: reset, unlock, clear faults
struct ShutdownOrder {};  // hold, stop extrusion, end the job: daemon exits
// Heats the nozzle where it stands, before a recovery moves any axis: it may be frozen into the
// part. No temperature: no longer. Ends by itself after `reheat_max` and whenever the rig is no
// longer idle; a recovered job takes the heat over.
struct ReheatOrder {
  std::optional<double> temperature_c;
};
using OperatorOrder = std::variant<StartOrder, HoldOrder, ResumeOrder, AbortOrder, EmergencyOrder,
                                   ClearOrder, ShutdownOrder, ReheatOrder>;

struct RigSnapshot {
  RigState state = RigState::kDisconnected;
  std::string sentence;  // why it is so, or what it waits for; may be empty
  bool cnc_open = false;
  bool extruder_open = false;
  std::optional<CncStatus> cnc;
  std::string cnc_version;
  std::optional<wire::Status> extruder;
  bool depositing = false;  // between M72 and M73, by our orders
  std::optional<JobId> job;
  LineNumber lines = 0;  // of the job's program
  LineCertainty certainty;
  int unacknowledged_bytes = 0;
  std::int64_t relayed = 0;  // M-codes done in this job
};

class Sequencer {
 public:
  // `cnc` is the dialect of rig.cnc.dialect (make_cnc_device).
  Sequencer(RigDescription rig, std::unique_ptr<CncDevice> cnc, CoreOptions options);
  ~Sequencer();

  // Before the first link_opened: the journal holds a job that was running. Its final state is the
  // journal's to write (recovery.h); here it makes the first byte to the CNC a hold and M73 the
  // extruder's first order.
  void recover_interrupted();

  void link_opened(Instant now, Link link);
  void link_lost(Instant now, Link link, std::string_view why);
  void receive(Instant now, Link link, std::string_view bytes);
  void horizon_durable(Instant now, JobId job, LineNumber line);
  void tick(Instant now);

  // Refused with a sentence, or accepted and under way (the outcome comes as actions).
  Status order(Instant now, const OperatorOrder& order);

  Instant next_deadline() const;
  std::vector<Action> take_actions();
  RigSnapshot snapshot() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The dialect named by the rig file; an error for one that is not built.
Result<std::unique_ptr<CncDevice>> make_cnc_device(const CncLink& link);

}  // namespace reforge
