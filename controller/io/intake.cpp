#include "controller/io/intake.h"

#include <unistd.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/thread_pool.hpp>
#include <cerrno>
#include <cstring>
#include <fstream>

#include "controller/io/program_file.h"
#include "protocols/sha256.h"

namespace reforge {
namespace {

namespace fs = std::filesystem;

// A job of ten million lines has some 300 MB of program; meshes come to less.
constexpr std::uintmax_t kJobBytesMax = std::uintmax_t{8} << 30;

Status copy_files(const fs::path& from, const fs::path& to) {
  const auto files = job_files(from);
  if (!files) return files.error();
  std::error_code failed;
  std::uintmax_t bytes = 0;
  for (const fs::path& file : *files) {
    bytes += fs::file_size(from / file, failed);
    if (!failed && bytes > kJobBytesMax) {
      return Error{Code::kOutOfRange, from.string() + ": the job has more than 8 GiB."};
    }
    if (!failed) fs::create_directories((to / file).parent_path(), failed);
    if (!failed) fs::copy_file(from / file, to / file, failed);
    if (failed) {
      return Error{Code::kUnreadable,
                   (from / file).string() + ": cannot be copied: " + failed.message() + "."};
    }
  }
  return Unit{};
}

Result<TakenIn> take_in(const fs::path& folder, const fs::path& directory) {
  // What is wrong is said of the folder the operator knows, before anything is copied.
  auto given = read_job(folder);
  if (!given) return given.error();
  std::string copy = (directory / "XXXXXX").string();
  if (mkdtemp(copy.data()) == nullptr) {
    return Error{Code::kUnreadable, directory.string() + ": " + std::strerror(errno) + "."};
  }
  const auto refuse = [&](const Error& error) -> Result<TakenIn> {
    std::error_code ignored;
    fs::remove_all(copy, ignored);
    return error;
  };
  if (Status copied = copy_files(folder, copy); !copied) return refuse(copied.error());
  auto job = read_job(copy);
  if (!job) return refuse(job.error());
  if (job->program_sha256 != given->program_sha256) {
    return refuse({Code::kHashMismatch,
                   folder.string() + ": was changed while it was copied; submit it again."});
  }
  job->name = given->name;
  return TakenIn{*job, fs::path(copy).filename().string()};
}

Status write_program(ProgramSource& program, const RecoveryPlan& plan, const fs::path& file) {
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  const Status written =
      write_recovered(program, plan, [&](std::string_view line) { out << line << '\n'; });
  if (!written) return written;
  out.close();
  if (!out) return Error{Code::kUnreadable, file.string() + ": cannot be written."};
  return Unit{};
}

Result<RecoveredFolder> make_recovery(const fs::path& old, LineNumber lines,
                                      const RecoveryRequest& request, const fs::path& directory) {
  const auto job = read_job(old);
  if (!job) return job.error();
  const auto rig = read_rig(old / "rig.json");
  if (!rig) return rig.error();
  const auto program = ProgramFile::open(old / "program.nc", lines);
  if (!program) return program.error();
  auto plan = plan_recovery(**program, *rig, request);
  if (!plan) return plan.error();
  std::string copy = (directory / "XXXXXX").string();
  if (mkdtemp(copy.data()) == nullptr) {
    return Error{Code::kUnreadable, directory.string() + ": " + std::strerror(errno) + "."};
  }
  const auto refuse = [&](const Error& error) -> Result<RecoveredFolder> {
    std::error_code ignored;
    fs::remove_all(copy, ignored);
    return error;
  };
  if (Status copied = copy_files(old, copy); !copied) return refuse(copied.error());
  const fs::path file = fs::path(copy) / "program.nc";
  if (Status written = write_program(**program, *plan, file); !written) {
    return refuse(written.error());
  }
  std::error_code failed;
  fs::remove(fs::path(copy) / "certificate.json", failed);
  const auto hash = sha256_of_file(file);
  if (!hash) return refuse(hash.error());
  RecoveredFolder out{{*job, fs::path(copy).filename().string()}, std::move(*plan)};
  out.taken.job.program_sha256 = *hash;
  out.taken.job.lines = out.plan.lines;
  return out;
}

}  // namespace

struct Intake::Impl {
  Impl(boost::asio::io_context& context, fs::path copies)
      : io(context), directory(std::move(copies)) {}
  boost::asio::io_context& io;
  fs::path directory;
  boost::asio::thread_pool thread{1};
};

Intake::Intake(boost::asio::io_context& io, fs::path directory)
    : impl_(std::make_unique<Impl>(io, std::move(directory))) {}

Intake::~Intake() {
  impl_->thread.stop();
  impl_->thread.join();
}

void Intake::take(const fs::path& folder, std::function<void(Result<TakenIn>)> done) {
  boost::asio::post(impl_->thread, [&io = impl_->io, folder, directory = impl_->directory,
                                    done = std::move(done)]() mutable {
    auto taken = take_in(folder, directory);
    boost::asio::post(io, [taken = std::move(taken), done = std::move(done)] { done(taken); });
  });
}

void Intake::check(const std::string& copy, std::function<void(Result<JobFolder>)> done) {
  boost::asio::post(impl_->thread, [&io = impl_->io, copy = impl_->directory / copy,
                                    done = std::move(done)]() mutable {
    auto job = read_job(copy);
    boost::asio::post(io, [job = std::move(job), done = std::move(done)] { done(job); });
  });
}

void Intake::recover(const std::string& copy, LineNumber lines, const RecoveryRequest& request,
                     std::function<void(Result<RecoveredFolder>)> done) {
  boost::asio::post(impl_->thread, [&io = impl_->io, directory = impl_->directory, copy, lines,
                                    request, done = std::move(done)]() mutable {
    auto made = make_recovery(directory / copy, lines, request, directory);
    boost::asio::post(io, [made = std::move(made), done = std::move(done)] { done(made); });
  });
}

}  // namespace reforge
