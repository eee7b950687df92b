-- SLURM knows accounts and QOS from a database. This stands in for one and answers with the same errors; AllowAccounts=
-- would refuse every account here.
function slurm_job_submit(job, partitions, user)
  local wanted = "," .. (job.partition or "") .. ","
  if wanted:find(",lab,", 1, true) and job.account ~= "lab" then
    return slurm.ESLURM_INVALID_ACCOUNT
  end
  if job.qos ~= nil and job.qos ~= "normal" then
    return 2066 -- ESLURM_INVALID_QOS
  end
  return slurm.SUCCESS
end

function slurm_job_modify(job, record, partitions, user)
  return slurm.SUCCESS
end
