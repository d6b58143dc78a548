// The sequencer between a virtual CNC (the strict one of reforge-rig) and a simulated extruder, all
// in virtual time; keeps a log, and checks on every byte what must never happen.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "controller/core/sequencer.h"
#include "controller/io/simulated_extruder.h"
#include "tools/rig/grbl_controller.h"

namespace reforge {

class TextProgram final : public ProgramSource {
 public:
  explicit TextProgram(std::vector<std::string> lines) : lines_(std::move(lines)) {}
  LineNumber line_count() const override { return static_cast<LineNumber>(lines_.size()); }
  Result<std::string_view> line(LineNumber n) override {
    return std::string_view(lines_.at(static_cast<std::size_t>(n - 1)));
  }

 private:
  std::vector<std::string> lines_;
};

inline RigDescription bench_rig() {
  Result<RigDescription> rig = read_rig(REFORGE_SOURCE_DIR "/config/rigs/mx220.json");
  EXPECT_TRUE(rig.ok()) << (rig.ok() ? "" : rig.error().sentence);
  return *rig;
}

// A header, then the given lines, then the end.
inline std::shared_ptr<TextProgram> bench_program(const std::vector<std::string>& body,
                                                  const std::string& g54 = "X0.000 Y0.000 Z0.000") {
  std::vector<std::string> lines = {"; reforge-program: 1", "; g54: " + g54, "G21 G90 G94 G17 G54"};
  lines.insert(lines.end(), body.begin(), body.end());
  lines.push_back("M30");
  lines.push_back("; end");
  return std::make_shared<TextProgram>(lines);
}

// Milling back and forth, `count` moves of 2 mm: on for long when many.
inline std::vector<std::string> milling(int count, double feed = 600) {
  std::vector<std::string> out = {"M3 S12000", "G0 X0 Y0 Z20"};
  for (int i = 0; i < count; ++i) {
    out.push_back("G1 X" + std::to_string(i % 2 == 0 ? 2 : 0) + "." + std::to_string(i % 10) +
                  " Y" + std::to_string(i % 7) + " F" + std::to_string(static_cast<int>(feed)));
    if (i % 5 == 0) out.push_back("; a comment");
  }
  out.push_back("M5");
  return out;
}

// Two beads of `mm` each between M70 and M71.
inline std::vector<std::string> printing(int mm = 20) {
  std::vector<std::string> out = {"G0 X0 Y0 Z20", "M70 S205"};
  for (int bead = 0; bead < 2; ++bead) {
    for (const std::string& line :
         {std::string("G0 X0 Y") + std::to_string(bead), std::string("G1 Z5 F800"),
          std::string("M72 P0.3466"), std::string("G4 P0.1"), "G1 X" + std::to_string(mm) + " F500",
          std::string("M73"), "G1 X" + std::to_string(mm) + ".2 F500", std::string("M74 P1.0"),
          std::string("M75"), std::string("G0 Z20")}) {
      out.push_back(line);
    }
  }
  out.push_back("M71");
  return out;
}

class RigBench {
 public:
  explicit RigBench(CoreOptions options = virtual_ports(), RigDescription rig = bench_rig())
      : rig_(rig), cnc(std::make_unique<GrblController>(rig)), core(rig, device(rig), options) {}

  static CoreOptions virtual_ports() {
    CoreOptions options;
    options.ports_are_virtual = true;
    return options;
  }
  static std::unique_ptr<CncDevice> device(const RigDescription& rig) {
    return make_cnc_device(rig.cnc).value();
  }

  // --- what a test does
  void plug(Link link) {
    if (plugged(link)) return;
    plugged(link) = true;
    if (link == Link::kCnc) {
      cnc->take_transmitted();
      first_byte_due = true;
    } else {
      extruder.take_transmitted();
    }
    core.link_opened(now, link);
    settle();
  }
  void unplug(Link link) {
    plugged(link) = false;
    core.link_lost(now, link, "unplugged");
    settle();
  }
  void plug_both() {
    plug(Link::kCnc);
    plug(Link::kExtruder);
  }
  Status order(const OperatorOrder& what) {
    Status done = core.order(now, what);
    settle();
    return done;
  }
  bool start(std::shared_ptr<ProgramSource> program, Mode mode = Mode::kStrict) {
    if (!run_until([&] { return state() == RigState::kIdle; })) return false;
    lines_total = program->line_count();
    jobs.clear();
    const Status started = order(StartOrder{JobOrder{JobId{7}, "job", mode, std::move(program)}});
    if (!started) refusal = started.error().sentence;
    return started.ok();
  }
  void power_cycle_cnc() {
    cnc = std::make_unique<GrblController>(rig_);
    cnc->advance_to(now.count());
  }

  bool run_until(const std::function<bool()>& goal, Duration limit = std::chrono::seconds(600)) {
    const Instant end = now + limit;
    while (!goal()) {
      if (now >= end) return false;
      Instant next = now + std::chrono::milliseconds(10);
      next = earlier(next, std::max(now, core.next_deadline()));
      next = earlier(next, std::max(now, Instant(cnc->next_event_ns())));
      next = earlier(next, std::max(now, extruder.next_event()));
      if (horizon_at && !journal_stuck) next = earlier(next, std::max(now, *horizon_at));
      for (int link = 0; link < kLinkCount; ++link)
        next = earlier(next, std::max(now, reopen_at[link]));
      now = std::max(next, now + std::chrono::microseconds(1));
      settle();
    }
    return true;
  }
  void run_for(Duration time) {
    run_until([] { return false; }, time);
  }
  bool run_to_end() {
    return run_until([&] { return job_over(); });
  }

  // --- what a test asks
  RigState state() const { return core.snapshot().state; }
  bool job_over() const { return !jobs.empty() && api::is_over(jobs.back().state); }
  JobState job_state() const { return jobs.empty() ? JobState::kReady : jobs.back().state; }
  const std::string& job_sentence() const { return jobs.back().sentence; }
  std::vector<int> m_codes() const {
    std::vector<int> out;
    for (const auto& e : extruder.executed) out.push_back(e.m_code);
    return out;
  }
  bool plugged(Link link) const { return plugged_[static_cast<std::size_t>(link)]; }
  bool& plugged(Link link) { return plugged_[static_cast<std::size_t>(link)]; }

  RigDescription rig_;
  std::unique_ptr<GrblController> cnc;
  SimulatedExtruder extruder;
  Sequencer core;
  Instant now{};

  // Faults on the CNC's wire: may change what the CNC says before the core hears it.
  std::function<std::string(std::string)> spoil;
  bool cnc_mute = false;
  bool doubled_acknowledgement = false;  // nobody can count bytes right after a forged `ok`
  bool journal_stuck = false;
  Duration journal_delay = std::chrono::milliseconds(3);

  std::vector<JobChanged> jobs;
  std::vector<StateChanged> states;
  std::vector<std::string> notes;
  std::string refusal;
  std::string cnc_bytes;  // all that was written to the CNC, in order
  std::vector<std::string>
      order_of_events;  // "M73", "!", "reset", "line ..." as they left the core
  LineNumber horizon = 0;
  LineNumber acknowledged = 0;
  LineNumber lines_total = 0;
  bool first_byte_due = false;
  bool owes_hold = false;  // the test expects a hold as the first byte of the next opening
  bool only_holds_and_queries = false;
  std::vector<CncEvent> cnc_log;

  // Brings everything up to `now` and to rest.
  void settle() {
    cnc->advance_to(now.count());
    extruder.advance(now);
    for (const CncEvent& event : cnc->take_events()) cnc_log.push_back(event);
    for (int link = 0; link < kLinkCount; ++link) {
      if (now < reopen_at[link]) continue;
      reopen_at[link] = kNever;
      plug(static_cast<Link>(link));
    }
    if (horizon_at && now >= *horizon_at && !journal_stuck) {
      horizon = horizon_asked;
      horizon_at.reset();
      core.horizon_durable(now, JobId{7}, horizon);
    }
    if (now >= core.next_deadline()) core.tick(now);
    for (bool again = true; again;) {
      again = false;
      for (const Action& action : core.take_actions()) {
        again = true;
        perform(action);
      }
      std::string said = cnc->take_transmitted();
      if (spoil && !said.empty()) said = spoil(said);
      if (plugged(Link::kCnc) && !cnc_mute && !said.empty()) {
        again = true;
        core.receive(now, Link::kCnc, said);
      }
      said = extruder.take_transmitted();
      if (plugged(Link::kExtruder) && !said.empty()) {
        again = true;
        core.receive(now, Link::kExtruder, said);
      }
    }
    const RigSnapshot snapshot = core.snapshot();
    EXPECT_LE(snapshot.unacknowledged_bytes, rig_.cnc.receive_buffer_bytes);
    EXPECT_LE(snapshot.certainty.executed, snapshot.certainty.acknowledged);
    EXPECT_LE(snapshot.certainty.acknowledged, snapshot.certainty.sent);
    EXPECT_LE(snapshot.certainty.sent, snapshot.certainty.horizon);
    if (snapshot.job) {
      EXPECT_LE(snapshot.certainty.horizon, horizon) << "not durable yet";
    }
    if (!doubled_acknowledgement) {
      EXPECT_EQ(cnc->bytes_lost(), 0);
    }
  }

 private:
  void perform(const Action& action) {
    if (const auto* send = std::get_if<Send>(&action)) {
      ASSERT_TRUE(plugged(send->link)) << "bytes for a closed " << name(send->link);
      if (send->link == Link::kExtruder) {
        note_extruder(send->bytes);
        extruder.receive(now, send->bytes);
        return;
      }
      if (first_byte_due && owes_hold) {
        EXPECT_EQ(send->bytes.front(), '!');
      }
      first_byte_due = false;
      if (only_holds_and_queries) {
        EXPECT_EQ(send->bytes.find_first_not_of("!?"), std::string::npos) << send->bytes;
      }
      cnc_bytes += send->bytes;
      note_cnc(send->bytes);
      cnc->receive(send->bytes);
    } else if (const auto* reopen = std::get_if<Reopen>(&action)) {
      plugged(reopen->link) = false;
      reopen_at[static_cast<int>(reopen->link)] = now + std::chrono::milliseconds(200);
    } else if (const auto* request = std::get_if<RequestHorizon>(&action)) {
      EXPECT_GT(request->line, horizon);
      horizon_asked = request->line;
      if (!horizon_at) horizon_at = now + journal_delay;
    } else if (const auto* acks = std::get_if<Acknowledged>(&action)) {
      EXPECT_GE(acks->certainty.acknowledged, acknowledged);
      acknowledged = acks->certainty.acknowledged;
    } else if (const auto* job = std::get_if<JobChanged>(&action)) {
      jobs.push_back(*job);
      if (job->state == JobState::kReady || api::is_over(job->state)) {
        EXPECT_FALSE(job->sentence.empty() && job->state != JobState::kDone);
        horizon = acknowledged = 0;
      }
    } else if (const auto* change = std::get_if<StateChanged>(&action)) {
      states.push_back(*change);
    } else if (const auto* text = std::get_if<Note>(&action)) {
      notes.push_back(text->sentence);
    }
  }

  void note_cnc(const std::string& bytes) {
    if (bytes == "?") return;
    order_of_events.push_back(bytes == "\x18" ? "reset" : bytes);
  }
  void note_extruder(const std::string& bytes) {
    wire::Decoder decoder;
    wire::Frame frame;
    wire::Command command;
    for (const char c : bytes) {
      decoder.push(static_cast<std::uint8_t>(c));
      while (decoder.take(frame)) {
        if (unpack(frame, command)) order_of_events.push_back("M" + std::to_string(command.m_code));
      }
    }
  }

  std::array<bool, kLinkCount> plugged_{};
  Instant reopen_at[kLinkCount] = {kNever, kNever};
  std::optional<Instant> horizon_at;
  LineNumber horizon_asked = 0;
};

}  // namespace reforge
