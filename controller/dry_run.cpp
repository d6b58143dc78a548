#include "controller/dry_run.h"

#include <algorithm>
#include <array>

#include "controller/core/sequencer.h"
#include "controller/io/program_file.h"
#include "controller/io/simulated_cnc.h"
#include "controller/io/simulated_extruder.h"
#include "protocols/sha256.h"

namespace reforge {
namespace {

constexpr Duration kLook = std::chrono::milliseconds(50);     // the board's dead-men have no event
constexpr Duration kAnswer = std::chrono::microseconds(100);  // what is sent arrives so much later
constexpr Duration kPatience = std::chrono::minutes(10);      // without an event of the job
constexpr std::size_t kDigestChunk = 1 << 16;

class Run {
 public:
  Run(const RigDescription& rig, const JobOrder& job)
      : job_(job), cnc_(rig), core_(rig, make_cnc_device(rig.cnc).value(), options()) {}

  DryRun to_the_end() {
    core_.link_opened(now_, Link::kCnc);
    core_.link_opened(now_, Link::kExtruder);
    while (!over_) {
      settle();
      if (!started_ && core_.snapshot().state == RigState::kIdle) start();
      if (now_ - last_progress_ > kPatience) give_up();
      if (over_) break;
      const Instant next = earlier(earlier(core_.next_deadline(), now_ + kLook),
                                   earlier(cnc_.next_event(), extruder_.next_event()));
      now_ = std::max(next, now_ + kAnswer);
    }
    out_.machine_s = std::chrono::duration<double>(now_ - began_).count();
    out_.digest = sha256_hex(sent_);
    return out_;
  }

 private:
  static CoreOptions options() {
    CoreOptions out;
    out.ports_are_virtual = true;
    return out;
  }

  void start() {
    started_ = true;
    began_ = now_;
    const Status accepted = core_.order(now_, StartOrder{job_});
    if (!accepted) end(JobState::kFailed, accepted.error().sentence);
    settle();
  }

  void give_up() {
    end(JobState::kFailed, "Nothing has happened for ten simulated minutes; the rig is " +
                               std::string(name(core_.snapshot().state)) + ".");
  }

  void end(JobState state, std::string sentence) {
    over_ = true;
    out_.state = state;
    out_.sentence = std::move(sentence);
  }

  // Until nobody has anything more to say at this moment.
  void settle() {
    cnc_.advance(now_);
    extruder_.advance(now_);
    if (now_ >= core_.next_deadline()) core_.tick(now_);
    for (bool again = true; again;) {
      again = false;
      for (const Action& action : core_.take_actions()) {
        again = true;
        std::visit([this](const auto& what) { perform(what); }, action);
      }
      out_.unacknowledged_peak =
          std::max(out_.unacknowledged_peak, core_.snapshot().unacknowledged_bytes);
      if (const std::string said = cnc_.take_transmitted(); !said.empty()) {
        again = true;
        core_.receive(now_, Link::kCnc, said);
      }
      if (const std::string said = extruder_.take_transmitted(); !said.empty()) {
        again = true;
        core_.receive(now_, Link::kExtruder, said);
      }
    }
  }

  void perform(const Send& action) {
    const auto at = static_cast<std::uint64_t>(now_.count());
    std::array<char, 9> mark{};
    mark[0] = action.link == Link::kCnc ? 'c' : 'e';
    for (std::size_t i = 0; i < 8; ++i) mark[i + 1] = static_cast<char>(at >> (8 * i) & 0xFF);
    sent_.append(mark.data(), mark.size());
    sent_ += action.bytes;
    // Folded, so that a long job does not gather in memory.
    if (sent_.size() > kDigestChunk) sent_ = sha256_hex(sent_);
    if (action.link == Link::kCnc) {
      out_.bytes += static_cast<std::int64_t>(action.bytes.size());
      cnc_.receive(now_, action.bytes);
    } else {
      extruder_.receive(now_, action.bytes);
    }
  }
  void perform(const DropUnsent&) {}
  void perform(const Reopen& action) { core_.link_opened(now_, action.link); }
  void perform(const RequestHorizon& action) {
    core_.horizon_durable(now_, action.job, action.line);
  }
  void perform(const Acknowledged& action) {
    last_progress_ = now_;
    out_.certainty = action.certainty;
  }
  void perform(const JobChanged& action) {
    last_progress_ = now_;
    out_.certainty = action.certainty;
    out_.relayed = action.relayed;
    const bool refused = action.state == JobState::kReady;
    if (refused || is_over(action.state)) {
      end(refused ? JobState::kFailed : action.state, action.sentence);
    } else if (action.state == JobState::kHeld) {
      end(JobState::kHeld, action.sentence);
    }
  }
  void perform(const StateChanged&) { last_progress_ = now_; }
  void perform(const Note&) {}

  JobOrder job_;
  SimulatedCnc cnc_;
  SimulatedExtruder extruder_;
  Sequencer core_;
  Instant now_{};
  Instant began_{};
  Instant last_progress_{};
  bool started_ = false;
  bool over_ = false;
  std::string sent_;
  DryRun out_;
};

}  // namespace

DryRun dry_run(const RigDescription& rig, const JobOrder& job) {
  return Run(rig, job).to_the_end();
}

Result<DryRun> dry_run(const std::filesystem::path& folder) {
  const auto job = read_job(folder);
  if (!job) return job.error();
  const auto rig = read_rig(folder / "rig.json");
  if (!rig) return rig.error();
  if (const auto cnc = make_cnc_device(rig->cnc); !cnc) return cnc.error();
  const auto program = ProgramFile::open(folder / "program.nc", job->lines);
  if (!program) return program.error();
  return dry_run(*rig, JobOrder{JobId{1}, job->name, job->mode, *program});
}

}  // namespace reforge
