#include "tests/scenarios/shop.h"

#include <signal.h>
#include <sqlite3.h>

#include <chrono>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "tests/support/job_folder.h"

namespace reforge::testing {

using nlohmann::json;

Shop::Shop() {
  const std::string here = scratch_.path.string();
  const json nobody = {{"users", json::array()}, {"groups", json::array()}};
  config = {{"format", "reforged 1"},
            {"socket", here + "/reforged.sock"},
            {"state_directory", here + "/state"},
            {"rig", shipped_rig_file().string()},
            {"clock", here + "/clock.sock"},
            {"ports",
             {{"cnc", {{"path", here + "/rig/cnc"}, {"kind", "virtual"}}},
              {"extruder", {{"path", here + "/rig/extruder"}, {"kind", "virtual"}}}}},
            {"roles", {{"observe", nobody}, {"operate", nobody}, {"administer", nobody}}},
            {"verifier", {{"command", {"/bin/true"}}, {"limits", nullptr}}},
            {"limits", {{"clients", 16}, {"waiting_jobs", 16}}}};
}

void Shop::start_rig(const std::string& speed) {
  const std::string here = scratch_.path.string();
  rig_ = std::make_unique<Process>(
      std::vector<std::string>{REFORGE_RIG, "--rig", shipped_rig_file().string(), "--dir",
                               here + "/rig", "--speed", speed, "--clock", here + "/clock.sock",
                               "--trace", here + "/trace.jsonl", "--firmware",
                               REFORGE_FIRMWARE_ELF},
      std::vector<std::string>{}, scratch_.path / "rig.log");
  if (!wait_until([&] { return std::filesystem::exists(here + "/rig/extruder"); })) {
    throw std::runtime_error("the rig does not come up: " + read_file(scratch_.path / "rig.log"));
  }
}

void Shop::start_daemon() {
  const std::string here = scratch_.path.string();
  link_.reset();
  std::filesystem::remove(here + "/reforged.sock");
  write_file(scratch_.path / "reforged.json", config.dump(1));
  daemon_ = std::make_unique<Process>(
      std::vector<std::string>{REFORGE_DAEMON, "--config", here + "/reforged.json"},
      std::vector<std::string>{"LD_PRELOAD=" REFORGE_PTYPORT_LIBRARY,
                               "REFORGE_RIG_DTR=" + here + "/rig/dtr.sock",
                               // The preloaded library stands before the sanitizer's.
                               "ASAN_OPTIONS=verify_asan_link_order=0:detect_leaks=0"},
      scratch_.path / "reforged.log");
  wait_until([&] {
    if (auto connected = DaemonLink::connect(here + "/reforged.sock")) {
      link_ = std::make_unique<DaemonLink>(std::move(*connected));
    }
    return link_ != nullptr || !daemon_->runs();
  });
  if (!link_) throw std::runtime_error("the daemon does not come up: " + daemon_log());
}

void Shop::kill_daemon() {
  daemon_->send_signal(SIGKILL);
  daemon_->end_within(60);
  link_.reset();
}

std::string Shop::daemon_log() const {
  return read_file(scratch_.path / "reforged.log");
}

Result<json> Shop::try_call(api::Method method, const json& params) {
  return link_->call(method, params);
}

json Shop::call(api::Method method, const json& params) {
  auto answer = try_call(method, params);
  if (!answer) {
    throw std::runtime_error(std::string(api::name_of(method)) + ": " + answer.error().sentence +
                             "\n" + daemon_log());
  }
  return *answer;
}

std::int64_t Shop::ready_job(const std::string& name, const std::string& program_body) {
  make_job(scratch_.path / name, program_body);
  const json answer = call(api::Method::kSubmit, {{"path", (scratch_.path / name).string()}});
  const auto number = answer.at("job").get<std::int64_t>();
  if (!wait_for_state(number, api::JobState::kReady)) {
    throw std::runtime_error("job not ready: " + job(number).reason);
  }
  return number;
}

void Shop::start(std::int64_t job) {
  call(api::Method::kConfirm, {{"job", job}});
  call(api::Method::kStart, {{"job", job}});
}

api::JobReport Shop::job(std::int64_t number) {
  auto report = api::job_report(call(api::Method::kStatus, {{"job", number}}).at("job"));
  if (!report) throw std::runtime_error(report.error().sentence);
  return *report;
}

std::string Shop::rig_state() {
  return call(api::Method::kStatus).at("rig").at("state").get<std::string>();
}

bool Shop::wait_until(const std::function<bool()>& holds) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  while (!holds()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return true;
}

bool Shop::wait_for_state(std::int64_t number, api::JobState state) {
  return wait_until([&] {
           const api::JobState now = job(number).state;
           return now == state || (is_over(now) && !is_over(state));
         }) &&
         job(number).state == state;
}

std::int64_t Shop::rows(const std::string& what) const {
  sqlite3* database = nullptr;
  sqlite3_stmt* statement = nullptr;
  std::int64_t count = -1;
  const std::string sql = "SELECT count(*) FROM " + what;
  if (sqlite3_open((scratch_.path / "state/journal.sqlite").c_str(), &database) == SQLITE_OK &&
      sqlite3_prepare_v2(database, sql.c_str(), -1, &statement, nullptr) == SQLITE_OK &&
      sqlite3_step(statement) == SQLITE_ROW) {
    count = sqlite3_column_int64(statement, 0);
  }
  sqlite3_finalize(statement);
  sqlite3_close(database);
  return count;
}

std::vector<json> Shop::trace() const {
  std::vector<json> out;
  std::istringstream lines(read_file(scratch_.path / "trace.jsonl"));
  for (std::string line; std::getline(lines, line);) {
    json record = json::parse(line, nullptr, false);
    if (record.is_object()) out.push_back(std::move(record));  // the last may be half written
  }
  return out;
}

std::vector<json> of_kind(const std::vector<json>& trace, const char* kind, std::size_t begin) {
  std::vector<json> out;
  for (std::size_t i = begin; i < trace.size(); ++i) {
    if (trace[i].at("ev") == kind) out.push_back(trace[i]);
  }
  return out;
}

}  // namespace reforge::testing
