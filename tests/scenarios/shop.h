// A shop for a scenario: the real daemon and the real virtual rig (with the real firmware) as
// processes in a folder of their own, joined by pseudo-terminals, and an operator at the socket.
//
// The daemon's clock is the rig's, so nothing here depends on how fast the computer is; waiting
// gives up after a minute. Jobs are hand-written (tests/support/job_folder.h); unless a scenario
// says otherwise the verifier is /bin/true, since these scenarios are about running and not about
// proving.
#pragma once

#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/rig/scratch_folder.h"
#include "tests/scenarios/process.h"
#include "tools/reforge/daemon_link.h"

namespace reforge::testing {

class Shop {
 public:
  Shop();

  nlohmann::json config;  // of the daemon; change it before starting one

  void start_rig(const std::string& speed = "max");
  void start_daemon();
  Process& daemon() { return *daemon_; }
  Process& rig() { return *rig_; }
  void kill_daemon();  // as `kill -9` does
  std::filesystem::path folder() const { return scratch_.path; }
  std::string daemon_log() const;

  // The operator. A refusal throws, with its sentence.
  nlohmann::json call(api::Method method, const nlohmann::json& params = nlohmann::json::object());
  Result<nlohmann::json> try_call(api::Method method,
                                  const nlohmann::json& params = nlohmann::json::object());
  // Submits a job with this program and waits until it is ready.
  std::int64_t ready_job(const std::string& name, const std::string& program_body);
  void start(std::int64_t job);  // confirms its checklist and starts it
  api::JobReport job(std::int64_t number);
  std::string rig_state();

  // False after a minute.
  bool wait_until(const std::function<bool()>& holds);
  bool wait_for_state(std::int64_t job, api::JobState state);

  // Records of the journal: `what` is a table, with a condition if need be.
  std::int64_t rows(const std::string& what) const;

  // What the rig has written so far.
  std::vector<nlohmann::json> trace() const;

 private:
  ScratchFolder scratch_;
  std::unique_ptr<Process> rig_;
  std::unique_ptr<Process> daemon_;
  std::unique_ptr<DaemonLink> link_;
};

// The records of one kind, from record `begin` on.
std::vector<nlohmann::json> of_kind(const std::vector<nlohmann::json>& trace, const char* kind,
                                    std::size_t begin = 0);

}  // namespace reforge::testing
