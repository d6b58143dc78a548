#include "planner/program/job_folder.h"

#include <unistd.h>

#include <fstream>

#include "planner/geometry/mesh_io.h"

namespace reforge {
namespace {

namespace fs = std::filesystem;

Error unwritable(const fs::path& path, const std::string& why) {
  return {Code::kUnreadable, path.string() + ": cannot be written (" + why + ")"};
}

}  // namespace

JobDraft::JobDraft(fs::path job, fs::path draft, bool replace)
    : job_(std::move(job)), draft_(std::move(draft)), replace_(replace) {}

JobDraft::JobDraft(JobDraft&& other) noexcept
    : job_(std::move(other.job_)), draft_(std::move(other.draft_)), replace_(other.replace_) {
  other.draft_.clear();
}

JobDraft::~JobDraft() {
  std::error_code ignored;  // a draft that cannot be removed is a hidden folder left behind, no job
  if (!draft_.empty()) fs::remove_all(draft_, ignored);
}

Result<JobDraft> JobDraft::begin(const fs::path& job, bool replace) {
  std::error_code error;
  fs::path final_name = fs::absolute(job, error).lexically_normal();
  if (!final_name.has_filename()) final_name = final_name.parent_path();
  if (fs::exists(final_name, error) && !replace) {
    return Error{Code::kUsage, job.string() + ": is there already; --force replaces it"};
  }
  if (fs::exists(final_name, error) && !fs::exists(final_name / "plan.json", error) &&
      !(fs::is_directory(final_name, error) && fs::is_empty(final_name, error))) {
    return Error{Code::kUsage, job.string() + ": is no job folder, so --force does not replace it"};
  }
  const fs::path draft = final_name.parent_path() / ("." + final_name.filename().string() +
                                                     ".draft-" + std::to_string(::getpid()));
  fs::create_directories(draft / "blocks", error);
  if (error) return unwritable(draft, error.message());
  return JobDraft(std::move(final_name), draft, replace);
}

Status JobDraft::write(const std::string& name, std::string_view bytes) const {
  std::ofstream out(draft_ / name, std::ios::binary);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  out.close();
  if (!out) return unwritable(draft_ / name, "is the disk full?");
  return Unit{};
}

Status JobDraft::write(const std::string& name, const TriangleMesh& mesh) const {
  return write_binary_stl(mesh, draft_ / name);
}

Status JobDraft::publish() {
  std::error_code error;
  if (fs::is_empty(draft_ / "blocks", error)) fs::remove(draft_ / "blocks", error);
  if (replace_ && fs::exists(job_, error)) {
    // The old job moves aside first, so that one of the two is there at every moment but one.
    const fs::path old = draft_.string() + ".old";
    fs::rename(job_, old, error);
    if (error) return unwritable(job_, error.message());
    fs::rename(draft_, job_, error);
    if (error) return unwritable(job_, error.message());
    fs::remove_all(old, error);
  } else {
    fs::rename(draft_, job_, error);
    if (error) return unwritable(job_, error.message());
  }
  draft_.clear();
  return Unit{};
}

}  // namespace reforge
