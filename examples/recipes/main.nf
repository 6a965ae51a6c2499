// Nextflow: a process per structure. `nextflow run main.nf`; what fails is left out.
params.structures = 'structures/*.pdb'
params.out = 'out'

process mesh {
    cpus 4
    errorStrategy 'ignore'
    publishDir params.out, mode: 'move'

    input:
    path structure

    output:
    path "${structure.simpleName}"

    script:
    "00_pipeline $structure --out ${structure.simpleName} --threads $task.cpus --no-pictures --quiet"
}

workflow {
    channel.fromPath(params.structures) | mesh
}
