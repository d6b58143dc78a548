#include "tools/reforge/daemon_commands.h"

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <memory>

#include "tools/reforge/daemon_link.h"
#include "tools/reforge/watch.h"

namespace reforge {
namespace {

using nlohmann::json;

struct Chosen {
  std::string socket;
  bool as_json = false;
  std::int64_t job = 0;
  std::string path;
  std::string state;
  std::string reason;
  std::string bead;
  std::int64_t program_path = 0;
  double celsius = 0;
  bool off = false;
  std::vector<std::string> items;
  bool all = false;
  bool wait = false;
  bool word = false;  // --bead-inspected, --module-may-retreat
};

std::string default_socket() {
  const char* given = std::getenv(api::kSocketVariable);
  return given != nullptr && *given != '\0' ? given : api::kDefaultSocket;
}

std::string text(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : "";
}

void print_link(const char* title, const json& link) {
  const std::string detail = text(link, "detail");
  std::printf("%-9s %s %s%s%s\n", title, text(link, "path").c_str(),
              link.value("up", false) ? text(link, "state").c_str() : "down",
              detail.empty() ? "" : ": ", detail.c_str());
}

void print_rig(const json& rig) {
  const std::string reason = text(rig, "reason");
  std::printf("rig       %s, %s%s%s\n", text(rig, "name").c_str(), text(rig, "state").c_str(),
              reason.empty() ? "" : ": ", reason.c_str());
  print_link("cnc", rig.at("cnc"));
  print_link("extruder", rig.at("extruder"));
  const json& temperature = rig.at("temperature_c");
  if (temperature.is_number()) {
    std::printf("nozzle    %.1f C\n", temperature.get<double>());
  } else {
    std::printf("nozzle    temperature unknown\n");
  }
}

void print_checklist(const api::JobReport& job) {
  for (const api::ChecklistItem& item : job.checklist) {
    std::printf("          [%s] %-9s %s\n", item.by.empty() ? " " : "x", item.item.c_str(),
                item.question.c_str());
  }
}

void print_job(const api::JobReport& job) {
  std::printf("job %-5lld %s: %s, %lld of %lld lines acknowledged, %lld toggles, %.1f s\n",
              static_cast<long long>(job.job), job.name.c_str(), api::name_of(job.state),
              static_cast<long long>(job.acknowledged), static_cast<long long>(job.lines),
              static_cast<long long>(job.toggles), job.machine_s);
  if (!job.reason.empty()) std::printf("          %s\n", job.reason.c_str());
  if (job.uncertain) {
    std::printf("          lines %lld to %lld may or may not have been sent\n",
                static_cast<long long>(job.uncertain->first),
                static_cast<long long>(job.uncertain->last));
  }
}

Status print_status(const json& status) {
  print_rig(status.at("rig"));
  if (const json& job = status.at("job"); !job.is_null()) {
    const auto report = api::job_report(job);
    if (!report) return report.error();
    print_job(*report);
  }
  const json& queue = status.at("queue");
  std::printf("queue     %zu waiting\n", queue.size());
  return Unit{};
}

Status print_jobs(const json& jobs) {
  for (const json& job : jobs.at("jobs")) {
    const auto report = api::job_report(job);
    if (!report) return report.error();
    print_job(*report);
  }
  return Unit{};
}

Status print_job_state(const json& result) {
  std::printf("job %lld: %s\n", static_cast<long long>(result.value("job", 0LL)),
              text(result, "state").c_str());
  return Unit{};
}

Status print_rig_state(const json& result) {
  print_rig(result.at("rig"));
  return Unit{};
}

// What the daemon answered, for a person or for a program.
Status show(const Result<json>& answer, bool as_json,
            const std::function<Status(const json&)>& say) {
  if (!answer) return answer.error();
  if (as_json) {
    std::printf("%s\n", answer->dump().c_str());
    return Unit{};
  }
  try {
    return say(*answer);
  } catch (const json::exception& e) {
    return Error{Code::kMalformed, std::string("The daemon's answer cannot be read: ") + e.what()};
  }
}

Status submit(DaemonLink& link, const Chosen& chosen) {
  std::error_code failed;
  const auto path = std::filesystem::absolute(chosen.path, failed).lexically_normal();
  if (failed) return Error{Code::kUnreadable, chosen.path + ": " + failed.message() + "."};
  return show(link.call(api::Method::kSubmit, {{"path", path.string()}}), chosen.as_json,
              print_job_state);
}

Status start(DaemonLink& link, const Chosen& chosen) {
  if (chosen.wait) {
    if (Status verified = wait_until_verified(link, chosen.job); !verified) return verified;
  }
  return show(link.call(api::Method::kStart, {{"job", chosen.job}}), chosen.as_json,
              print_job_state);
}

Status status(DaemonLink& link, const Chosen& chosen) {
  json params = json::object();
  if (chosen.job > 0) params["job"] = chosen.job;
  return show(link.call(api::Method::kStatus, params), chosen.as_json, print_status);
}

Status jobs(DaemonLink& link, const Chosen& chosen) {
  json params = json::object();
  if (!chosen.state.empty()) params["state"] = chosen.state;
  return show(link.call(api::Method::kJobs, params), chosen.as_json, print_jobs);
}

Status confirm(DaemonLink& link, const Chosen& chosen) {
  if (chosen.items.empty() && !chosen.all) {
    const auto status = link.call(api::Method::kStatus, {{"job", chosen.job}});
    return show(status, chosen.as_json, [](const json& answer) -> Status {
      const auto report = api::job_report(answer.at("job"));
      if (!report) return report.error();
      print_job(*report);
      print_checklist(*report);
      return Unit{};
    });
  }
  json params = {{"job", chosen.job}};
  if (!chosen.all) params["items"] = chosen.items;
  return show(link.call(api::Method::kConfirm, params), chosen.as_json,
              [](const json& answer) -> Status {
                const auto report = api::job_report(answer);
                if (!report) return report.error();
                print_job(*report);
                print_checklist(*report);
                return Unit{};
              });
}

Status admit(DaemonLink& link, const Chosen& chosen) {
  return show(link.call(api::Method::kAdmit, {{"job", chosen.job}, {"reason", chosen.reason}}),
              chosen.as_json, print_job_state);
}

Status recover(DaemonLink& link, const Chosen& chosen) {
  json params = {{"job", chosen.job}};
  if (!chosen.bead.empty()) params["bead"] = chosen.bead;
  if (chosen.program_path > 0) params["path"] = chosen.program_path;
  return show(link.call(api::Method::kRecover, params), chosen.as_json,
              [](const json& answer) -> Status {
                std::printf("job %lld: %s\nIt begins with:\n",
                            static_cast<long long>(answer.at("job").get<std::int64_t>()),
                            text(answer, "sentence").c_str());
                for (const json& line : answer.at("preamble")) {
                  std::printf("  %s\n", line.get<std::string>().c_str());
                }
                std::printf("It is verified now. Then: reforge confirm, reforge start.\n");
                return Unit{};
              });
}

Status reheat(DaemonLink& link, const Chosen& chosen) {
  json params = json::object();
  if (!chosen.off) params["temperature_c"] = chosen.celsius;
  return show(link.call(api::Method::kReheat, params), chosen.as_json, print_rig_state);
}

Status rig_order(DaemonLink& link, const Chosen& chosen, api::Method method, const char* word) {
  json params = json::object();
  if (word != nullptr && chosen.word) params[word] = true;
  return show(link.call(method, params), chosen.as_json, print_rig_state);
}

}  // namespace

void add_daemon_commands(CLI::App& app, Outcome& outcome) {
  using Run = std::function<Status(DaemonLink&, const Chosen&)>;
  const auto chosen = std::make_shared<Chosen>();
  chosen->socket = default_socket();
  const auto command = [&app, &outcome, chosen](const char* name, const char* help, Run run) {
    CLI::App* sub = app.add_subcommand(name, help);
    sub->add_option("--socket", chosen->socket, "The daemon's socket")->capture_default_str();
    sub->add_flag("--json", chosen->as_json, "Print the daemon's answer as JSON");
    sub->callback([&outcome, chosen, run = std::move(run)] {
      auto link = DaemonLink::connect(chosen->socket);
      if (!link) return report(outcome, link.error());
      if (Status done = run(*link, *chosen); !done) report(outcome, done.error());
    });
    return sub;
  };
  const auto with_job = [chosen](CLI::App* sub, bool required) {
    sub->add_option("JOB", chosen->job, "Number of the job")
        ->required(required)
        ->check(CLI::PositiveNumber);
    return sub;
  };

  command("submit", "Give a job folder to the daemon", submit)
      ->add_option("FOLDER", chosen->path, "The job")
      ->required();
  CLI::App* confirmed = with_job(
      command("confirm", "Confirm items of a job's setup checklist; without any, show it", confirm),
      true);
  confirmed->add_option("ITEM", chosen->items, "What was looked at and is right");
  confirmed->add_flag("--all", chosen->all, "Every item was looked at and is right");
  with_job(command("admit", "Override: let a job run that our verification did not pass", admit),
           true)
      ->add_option("--reason", chosen->reason, "Why; it is journalled")
      ->required();
  CLI::App* recovered = with_job(
      command("recover", "Make, of a job that ended early, one that finishes it", recover), true);
  recovered
      ->add_option("--bead", chosen->bead,
                   "Of a bead that may be half laid: it was taken off, or it is good")
      ->check(CLI::IsMember({"removed", "accepted"}));
  recovered
      ->add_option("--path", chosen->program_path, "Go on from this path of the program instead")
      ->check(CLI::PositiveNumber);
  CLI::App* reheated = command("reheat", "Heat the nozzle where it stands, without a job", reheat);
  reheated->add_option("CELSIUS", chosen->celsius, "Temperature")->check(CLI::PositiveNumber);
  reheated->add_flag("--off", chosen->off, "No longer");
  with_job(command("start", "Start a verified job", start), true)
      ->add_flag("--wait", chosen->wait, "First wait until it has been verified");
  with_job(command("watch", "Show a job until it ends; 0 only when it is done",
                   [&outcome](DaemonLink& link, const Chosen& c) {
                     return watch(link, c.job, c.as_json, outcome);
                   }),
           false);
  command("hold", "Feed hold, extrusion off", [](DaemonLink& link, const Chosen& c) {
    return rig_order(link, c, api::Method::kHold, nullptr);
  });
  command("resume", "Go on after a hold",
          [](DaemonLink& link, const Chosen& c) {
            return rig_order(link, c, api::Method::kResume, "bead_inspected");
          })
      ->add_flag("--bead-inspected", chosen->word,
                 "The bead under way at the hold was looked at and is good");
  with_job(command("abort", "End a job, or take it from the queue",
                   [](DaemonLink& link, const Chosen& c) {
                     return show(link.call(api::Method::kAbort, {{"job", c.job}}), c.as_json,
                                 print_job_state);
                   }),
           true);
  command("emergency", "Reset both devices at once; no substitute for an E-stop",
          [](DaemonLink& link, const Chosen& c) {
            return rig_order(link, c, api::Method::kEmergency, nullptr);
          });
  command("clear", "The rig was looked at: clear faults, reset what an ended job left",
          [](DaemonLink& link, const Chosen& c) {
            return rig_order(link, c, api::Method::kClear, "module_may_retreat");
          })
      ->add_flag("--module-may-retreat", chosen->word,
                 "The extruder module stands clear of the part and may be closed");
  with_job(command("status", "The rig and a job", status), false);
  command("jobs", "All jobs the daemon knows", jobs)
      ->add_option("--state", chosen->state, "Only those in this state");
}

}  // namespace reforge
