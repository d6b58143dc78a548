// The sequencer's inside, shared by sequencer.cpp (events in), sequencer_progress.cpp (what follows
// from them) and sequencer_effects.cpp (effects of the table into actions). For nobody else.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "controller/core/identity.h"
#include "controller/core/job_run.h"
#include "controller/core/sequencer.h"

namespace reforge {

struct Sequencer::Impl {
  Impl(RigDescription rig_description, std::unique_ptr<CncDevice> device, CoreOptions core_options);

  // Events.
  void take(const CncSession::Event& event);
  void take(const CncReport& event);
  void take(const CncStatus& status);
  void take(const ExtruderLink::Event& event);
  void take_acknowledgement();
  void take_rejection(const cnc::Rejected& rejected);
  void take_garbage(const cnc::Garbage& garbage);
  void link_opened(Link link);
  void link_lost(Link link, std::string_view why);
  Status order(const OperatorOrder& order);
  Status prepare(const StartOrder& start);
  Status fits_reheat(const ReheatOrder& heat) const;
  void reheat();
  void end_reheat();

  // One event through the table. The sentence says why, for journal and clients.
  void dispatch(RigEvent event, std::string sentence = {});
  void set_verdict(RigEvent event, const std::string& sentence);
  void perform(Effect effect, const std::string& sentence);

  // What follows from the present facts, until nothing does; then output is collected.
  void advance();
  void advance_identity();
  void advance_start();
  void advance_stream();
  void advance_drain();
  void advance_barrier();
  void advance_resume();
  void ask_horizon();
  void judge_running(const CncStatus& status);
  void judge_coming_to_rest(const CncStatus& status);
  void judge_extruder_status();
  bool acknowledgement_overdue(const CncStatus& status);

  void pause_extrusion();
  void stop_extrusion();
  void make_safe();
  bool module_is_clear() const;
  void hold_cnc();
  void reset_cnc();
  void reopen(Link link, const std::string& sentence);
  void end_job(const Verdict& verdict);
  void collect_output();
  void report_acknowledged();

  bool open(Link link) const { return open_[static_cast<std::size_t>(link)]; }
  bool& open(Link link) { return open_[static_cast<std::size_t>(link)]; }
  void send(Link link, std::string bytes, bool urgent);
  void note(Note::Level level, std::string sentence);
  bool awaits_rest() const;

  RigDescription rig;
  CoreOptions options;
  CncSession cnc;
  ExtruderLink extruder;
  Identity identity;
  DepositWatch watch;
  std::optional<JobRun> run;

  RigState state = RigState::kDisconnected;
  std::string sentence;  // of the state
  std::string waiting;   // for what, while identifying
  Instant now{};
  std::array<bool, kLinkCount> open_{};
  bool cnc_owed_hold = false;       // the first byte to the CNC
  bool extruder_owed_stop = false;  // M73 is the extruder's first order
  Instant rest_by = kNever;         // Hold:0 after a hold, the banner after a reset
  Instant hold_sent_at{};
  Instant settled_at{};  // after '~': statuses before it may be older than it
  std::int64_t garbage = 0;
  std::optional<double> reheat_c;   // the operator's last word on it
  Instant warm_until = kNever;      // heat without a job, until then
  bool module_may_retreat = false;  // the operator's word, with his clear
  bool module_was_clear = false;    // of the part, when the CNC was reset
  std::vector<Action> actions;
};

}  // namespace reforge
