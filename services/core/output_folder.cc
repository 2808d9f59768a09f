// SPDX-License-Identifier: Apache-2.0
#include "services/core/output_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <system_error>

namespace etude {
namespace {

namespace fs = std::filesystem;

// OUT without a slash at its end, absolute, so that its parent can be named; of a link what it leads to, which may lie
// on a larger disk
Path Plain(const Path& out) {
  Path whole = fs::absolute(out).lexically_normal();
  if (!whole.has_filename()) whole = whole.parent_path();
  std::error_code error;
  if (!fs::is_symlink(whole, error)) return whole;
  const Path leads_to = fs::weakly_canonical(whole, error);
  return error ? whole : leads_to;
}

// Where that cannot be asked, it is taken for none.
bool IsMountPoint(const Path& folder) {
  struct statx info {};
  return ::statx(AT_FDCWD, folder.c_str(), 0, STATX_TYPE, &info) == 0 &&
         (info.stx_attributes_mask & info.stx_attributes & STATX_ATTR_MOUNT_ROOT) != 0;
}

}  // namespace

Result<Path> ClaimOutput(const Path& out, Made made, Leftover leftover) {
  if (out.empty()) return Fail(Code::kInvalidArgument, "the place to write to is an empty name");
  const Path place = Plain(out);
  const Path partial = place.parent_path() / (place.filename().string() + ".partial");
  std::error_code error;
  if (made == Made::kFile && (!out.has_filename() || fs::is_directory(place, error)))
    return Fail(Code::kInvalidArgument,
                fmt::format("'{}' is a folder, and a file is made: name the file", out.string()));
  if (fs::exists(place, error) && !(fs::is_directory(place, error) && fs::is_empty(place, error)))
    return Fail(Code::kInvalidArgument,
                fmt::format("'{}' is there already; name another place, nothing is written over", place.string()));
  if (fs::is_symlink(place, error))  // Plain follows those that lead somewhere
    return Fail(Code::kInvalidArgument, fmt::format("'{}' is a link to '{}', where nothing is: name that place itself",
                                                    place.string(), fs::read_symlink(place, error).string()));
  if (IsMountPoint(place))
    return Fail(Code::kInvalidArgument,
                fmt::format("a disk is mounted at '{}', over which nothing can be renamed: name a folder in it",
                            place.string()));
  if (fs::exists(partial, error)) {
    if (leftover == Leftover::kRefuse)
      return Fail(Code::kInvalidArgument,
                  fmt::format("'{}' is what an earlier command left that did not end (or one that is at work now); "
                              "--restart removes it and begins anew",
                              partial.string()));
    fs::remove_all(partial, error);
    if (error) return Fail(ErrnoError("remove", partial, error.value()));
  }
  ETUDE_RETURN_IF_ERROR(MakeFolders(place.parent_path()));
  return partial;
}

Status CommitOutput(const Path& partial, const Path& out) {
  const Path place = Plain(out);
  std::error_code error;
  fs::rename(partial, place, error);  // over an empty folder, too
  if (error) return Fail(ErrnoError("rename to", place, error.value()));
  return SyncFolder(place.parent_path());
}

Result<OutputFolder> OutputFolder::Create(const Path& out, Leftover leftover) {
  ETUDE_ASSIGN_OR_RETURN(Path partial, ClaimOutput(out, Made::kFolder, leftover));
  ETUDE_RETURN_IF_ERROR(MakeFolders(partial));
  return OutputFolder(out, std::move(partial));
}

Status OutputFolder::Commit() { return CommitOutput(partial_, out_); }

}  // namespace etude
